"""One set of messages: for the wire, for recordings, and for journals."""
