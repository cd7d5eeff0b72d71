"""Who broke the protocol is in the type of the error.

    ProtocolError
     +-- LocalProtocolError   this program: a value out of range, a command while another is unanswered
     +-- RemoteProtocolError  the other end, or noise between: a frame that means nothing
          +-- CommandRefused    the device answered NAK
          +-- CommandUnanswered the device did not answer, however often asked
          +-- VersionMismatch   both ends speak, but not the same protocol
          +-- DevicesCollide    two devices under one node

Damaged frames are normal on a real cable: count a `RemoteProtocolError`, do not stop for it.
"""


class ProtocolError(Exception):
    """The protocol was broken."""


class LocalProtocolError(ProtocolError):
    """This program broke the protocol."""


class RemoteProtocolError(ProtocolError):
    """The other end broke the protocol, or noise did."""


class DevicesCollide(RemoteProtocolError):
    """More than one device answers under the node of this host's device."""


class CommandRefused(RemoteProtocolError):
    """The device answered NAK; `code` is its `NakCode`, the message its text and remedy."""

    def __init__(self, message: str, code: int):
        super().__init__(message)
        self.code = code


class CommandUnanswered(RemoteProtocolError):
    """The device did not answer a command, however often it was repeated."""


class VersionMismatch(RemoteProtocolError):
    """The two ends speak different versions of the protocol; the message says which one to upgrade."""
