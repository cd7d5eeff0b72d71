"""Protocol errors, classified by the side that caused them.

    ProtocolError
    +-- LocalProtocolError      this program: a value out of range, a command while another is unanswered
    +-- RemoteProtocolError     the other side, or noise: an invalid frame
    +-- CommandRefused          the device answered NAK
    +-- CommandUnanswered       the device did not answer after all repetitions
    +-- VersionMismatch         both sides use different versions of the protocol
    +-- DevicesCollide          two devices with the same node

Damaged frames are normal on a real cable: count a `RemoteProtocolError` and continue.
"""


class ProtocolError(Exception):
    """Violation of the protocol."""


class LocalProtocolError(ProtocolError):
    """Violation of the protocol by this program."""


class RemoteProtocolError(ProtocolError):
    """Violation of the protocol by the other side, or noise."""


class DevicesCollide(RemoteProtocolError):
    """More than one device answers under the node of this host's device."""


class CommandRefused(RemoteProtocolError):
    """The device answered NAK.

    `code` is its `NakCode`; the message contains its text and remedy.
    """

    def __init__(self, message: str, code: int):
        super().__init__(message)
        self.code = code


class CommandUnanswered(RemoteProtocolError):
    """The device did not answer a command after all repetitions."""


class VersionMismatch(RemoteProtocolError):
    """Both sides use different versions of the protocol.

    The message states which side to upgrade.
    """
