"""Keys of a monitor and its clients, as tests of streams use them."""

import zmq

from armguard.streams import Authenticator, Client, KeyPair, Keys


def make_pair():
    return KeyPair(*(key.decode() for key in zmq.curve_keypair()))


class KeyRing:
    """A monitor's pair, and those of its clients by name, each with what it may do."""

    def __init__(self, **rights):
        self.server = make_pair()
        self.pairs = {name: make_pair() for name in rights}
        self.clients = {
            name: Client(self.pairs[name].public, frozenset(may)) for name, may in rights.items()
        }

    def authenticator(self):
        return Authenticator(self.server, self.clients)

    def keys(self, name):
        return Keys(self.pairs[name], self.server.public)

    def stranger(self):
        return Keys(make_pair(), self.server.public)
