"""A journal that keeps what it is told, for tests of what is told."""


class Journal:
    """Keeps what it is told."""

    def __init__(self):
        self.told = []

    def __getattr__(self, name):
        def note(*arguments, **named):
            self.told.append((name, arguments, named))

        return note
