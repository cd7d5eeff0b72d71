"""Host side of the protocol, independent of the link."""

from dataclasses import dataclass, replace

from firmware_protocol.errors import (
    CommandRefused,
    CommandUnanswered,
    DevicesCollide,
    LocalProtocolError,
    RemoteProtocolError,
    VersionMismatch,
)
from firmware_protocol.identity import DeviceInfo, assemble, mismatch
from firmware_protocol.messages import (
    DEVICE_NODE,
    FIRST_HOST_NUMBER,
    NAMES,
    NUMBERS,
    Ack,
    Command,
    Frame,
    Hello,
    Info,
    KeepAlive,
    Message,
    Nak,
    NakCode,
    Status,
    Stop,
    decode,
    encode,
    explain,
)

KEEPALIVE_S = 0.1
"""Interval of keepalives, s: a fifth of the lease, so that four successive keepalives may be lost."""
RETRY_S = 0.1
"""Time without an answer after which a command is repeated, s."""
RETRIES = 5
"""Number of repetitions after which an unanswered command fails."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a command: accepted, or a `CommandRefused`, `CommandUnanswered` or `VersionMismatch`."""

    command: Command
    error: RemoteProtocolError | None = None


@dataclass(frozen=True, slots=True)
class _Pending:
    command: Command
    frame: Frame
    sent_at: float
    retries: int = 0


class HostSession:
    """Rules of the protocol for a host, independent of the link.

    One command is pending at a time. `hello` or `command` returns the frame to send. `receive` processes arriving
    frames. `due`, which is called every few hundredths of a second, returns repetitions and keepalives. `outcome`
    changes from None to the result of the command. Times are in seconds of any monotonic clock.
    """

    def __init__(self, node: int = DEVICE_NODE):
        self.node = node
        self.info: DeviceInfo | None = None
        """Identity of the device; None before the handshake."""
        self.status: Status | None = None
        """Last STATUS of the device; None before the first one."""
        self.outcome: Outcome | None = None
        """Result of the last command; None while it is pending."""
        self._pending: _Pending | None = None
        self._pages: dict[int, Info] = {}
        self._hello_answer: Ack | Nak | None = None
        self._token = 0
        self._keepalive_at = float("-inf")

    @property
    def pending(self) -> Command | None:
        """The pending command, or None if no command is pending."""
        return self._pending.command if self._pending else None

    def hello(self, now: float) -> Frame:
        """Start the handshake and return the frame to send.

        After its success, `info` contains the identity of the device.
        """
        frame = self.command(Hello(), now)
        self.info, self._hello_answer = None, None
        self._pages.clear()
        return frame

    def command(self, command: Command, now: float) -> Frame:
        """Start a command with a new token and return the frame to send.

        A `Stop` is always permitted and replaces the pending command.

        Raises:
            LocalProtocolError: another command is pending, or a field is out of its range.
        """
        if self._pending and not isinstance(command, Stop):
            raise LocalProtocolError(f"{_name(command)} must wait for the answer to {_name(self._pending.command)}")
        self._token = (self._token + 1) % 256
        command = replace(command, token=self._token)
        frame = encode(command, self.node)
        self._pending, self.outcome = _Pending(command, frame, now), None
        return frame

    def receive(self, frame: Frame) -> Message | None:
        """Decode a frame from the link and update the state.

        Returns:
            The message; None for a message of another node, of another host, or of a newer minor version.

        Raises:
            RemoteProtocolError: the frame is not valid.
            DevicesCollide: a second device answers under the same node.
        """
        if frame.node != self.node or frame.number >= FIRST_HOST_NUMBER or frame.number not in NAMES:
            return None
        message = decode(frame)
        if isinstance(message, Status):
            self.status = message
        elif isinstance(message, Info):
            self._read_info(message)
        elif isinstance(message, Ack | Nak) and self._pending:
            self._answered(self._pending.command, message)
        return message

    def due(self, now: float) -> list[Frame]:
        """Return the frames to send now: the repetition of an unanswered command, and a KEEPALIVE."""
        frames = self._retry(self._pending, now) if self._pending else []
        if self.info and now - self._keepalive_at >= KEEPALIVE_S:
            self._keepalive_at = now
            frames.append(encode(KeepAlive(), self.node))
        return frames

    def _retry(self, pending: _Pending, now: float) -> list[Frame]:
        if now - pending.sent_at < RETRY_S:
            return []
        if pending.retries == RETRIES:
            self._end(_unanswered(pending.command))
            return []
        self._pending = replace(pending, sent_at=now, retries=pending.retries + 1)
        return [pending.frame]

    def _read_info(self, page: Info) -> None:
        """Process a page of INFO.

        Raises:
            DevicesCollide: the page contradicts an earlier one, so another device sent it.
        """
        if page != self._pages.setdefault(page.page, page):
            raise DevicesCollide(
                f"two devices answer as node {self.node}: connect only one, or give one of them another node"
            )
        if isinstance(self.pending, Hello):
            self._greeted()
        elif self.info is not None:  # the optional page arrived after the handshake
            self.info = assemble(self._pages.values())

    def _answered(self, command: Command, message: Ack | Nak) -> None:
        if (message.command, message.token) != (NUMBERS[type(command)], command.token):
            return
        elif isinstance(command, Hello):
            self._hello_answer = message
            self._greeted()
        else:
            self._end(_refused(command, message) if isinstance(message, Nak) else None)

    def _greeted(self) -> None:
        """Finish HELLO if the answer and all pages have arrived, or if page 0 shows an incompatible version."""
        error: RemoteProtocolError | None = mismatch(self._pages[0].fields) if 0 in self._pages else None
        info: DeviceInfo | None = None
        try:
            info = assemble(self._pages.values())
        except RemoteProtocolError as invalid:
            error = error or invalid
        if error is None and (info is None or self._hello_answer is None):
            return
        if error is None and isinstance(self._hello_answer, Nak):
            error = _refused(Hello(), self._hello_answer)
        self.info = None if error else info
        self._end(error)

    def _end(self, error: RemoteProtocolError | None) -> None:
        assert self._pending
        self.outcome, self._pending = Outcome(self._pending.command, error), None


def _name(command: Command) -> str:
    return NAMES[NUMBERS[type(command)]]


def _unanswered(command: Command) -> CommandUnanswered:
    return CommandUnanswered(f"{_name(command)} was sent {RETRIES + 1} times and the device did not answer")


def _refused(command: Command, nak: Nak) -> RemoteProtocolError:
    text, remedy = explain(nak.code)
    sentence = f"the device refused {_name(command)}: {text} {remedy}"
    if nak.code in (NakCode.VERSION, NakCode.SCHEMA):
        return VersionMismatch(sentence)
    return CommandRefused(sentence, nak.code)
