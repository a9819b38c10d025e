"""A journal that keeps what it is told, for tests of what is told."""


class Journal:
    """Keeps what it is told."""

    def __init__(self):
        self.told = []

    def __getattr__(self, name):
        def note(*arguments, **named):
            self.told.append((name, arguments, named))

        return note

    def kinds(self):
        """What it was told, in order: types of messages, and names of other calls."""
        return [
            type(arguments[0]) if name == "note_message" else name
            for name, arguments, _ in self.told
        ]

    def messages(self, kind):
        """The messages of one type that it was told."""
        return [arguments[0] for _, arguments, _ in self.told if isinstance(arguments[0], kind)]
