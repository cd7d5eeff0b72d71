"""Identity of a device from its INFO pages, and its compatibility with this host."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from firmware_protocol.definition import PROTOCOL_VERSION, SCHEMA_HASH
from firmware_protocol.errors import RemoteProtocolError, VersionMismatch
from firmware_protocol.messages import ArmQuantity, Info, TorqueKind

PAGES = 8
"""Number of INFO pages of a complete identity, and number of the additional page of a device with joint drives."""
ARM_PAGE = PAGES + 1
"""Number of the additional INFO page of a device whose arm has a drive."""
_TORQUE_FLAGS = {"torque_measured": TorqueKind.MEASURED, "torque_commanded": TorqueKind.COMMANDED}
_INPUT_FLAGS = {"input_measured": TorqueKind.MEASURED, "input_commanded": TorqueKind.COMMANDED}


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """Identity of a device."""

    firmware: str
    """Firmware version, `major.minor.patch`."""
    uid: str
    """Unique identifier of the device: sixteen hexadecimal digits."""
    counts_per_rev: tuple[int, int, int]
    rate_max_hz: int
    rate_default_hz: int
    """Rate of the ticks while the device is not streaming, Hz."""
    simulated_time: bool = False
    """Whether ticks may run faster or slower than real time."""
    torque_kinds: tuple[TorqueKind, ...] = ()
    """Kinds of torques that follow every sample; empty for a device without drives."""
    torque_unit_uNm: int = 0
    """Unit of the torques in TORQUE, uN m."""
    input_kinds: tuple[TorqueKind, ...] = ()
    """Kinds of inputs of the arm's drive that follow every sample; empty without a drive of the arm."""
    input_unit: int = 0
    """Unit of the input in ARM_INPUT: uN m, uA or uV."""
    input_quantity: ArmQuantity | None = None
    """Quantity of the input of the arm's drive; None without one."""
    major: int = PROTOCOL_VERSION[0]
    minor: int = PROTOCOL_VERSION[1]
    schema_hash: int = SCHEMA_HASH

    @property
    def frames(self) -> int:
        """Number of frames per sample: SAMPLE, and one for each kind of torques and inputs."""
        return 1 + len(self.torque_kinds) + len(self.input_kinds)


def info_pages(info: DeviceInfo) -> list[Info]:
    """Create the INFO messages of an identity."""
    firmware = [int(part) for part in info.firmware.split(".")]
    flags = {flag: int(kind in info.torque_kinds) for flag, kind in _TORQUE_FLAGS.items()}
    of_arm = {flag: int(kind in info.input_kinds) for flag, kind in _INPUT_FLAGS.items()}
    uid = int(info.uid, 16)
    return [
        *([Info(PAGES, {"torque_unit": info.torque_unit_uNm, **flags})] if info.torque_kinds else []),
        *(
            [Info(ARM_PAGE, {"input_unit": info.input_unit, **of_arm, "input_quantity": info.input_quantity})]
            if info.input_quantity is not None
            else []
        ),
        Info(0, {"major": info.major, "minor": info.minor, "schema_hash": info.schema_hash}),
        Info(
            1,
            {
                **dict(zip(("firmware_major", "firmware_minor", "firmware_patch"), firmware, strict=True)),
                "simulated_time": int(info.simulated_time),
            },
        ),
        Info(2, {"uid_low": uid & 0xFFFFFFFF}),
        Info(3, {"uid_high": uid >> 32}),
        *(Info(4 + joint, {f"counts_per_rev{joint}": count}) for joint, count in enumerate(info.counts_per_rev)),
        Info(7, {"rate_max_hz": info.rate_max_hz, "rate_default_hz": info.rate_default_hz}),
    ]


def assemble(pages: Iterable[Info]) -> DeviceInfo | None:
    """Assemble an identity from INFO pages in any order; return None while a page is missing.

    Raises:
        RemoteProtocolError: page 9 declares an input of the arm without its quantity.
    """
    known = {page.page: page.fields for page in pages if page.page <= ARM_PAGE}
    if len(known.keys() - {PAGES, ARM_PAGE}) < PAGES:
        return None
    values = {name: value for fields in known.values() for name, value in fields.items()}
    unit, input_unit = values.get("torque_unit", 0), values.get("input_unit", 0)
    return DeviceInfo(
        firmware=f"{values['firmware_major']}.{values['firmware_minor']}.{values['firmware_patch']}",
        uid=f"{values['uid_high']:08x}{values['uid_low']:08x}",
        counts_per_rev=(values["counts_per_rev0"], values["counts_per_rev1"], values["counts_per_rev2"]),
        rate_max_hz=values["rate_max_hz"],
        rate_default_hz=values["rate_default_hz"],
        simulated_time=bool(values["simulated_time"]),
        torque_kinds=tuple(kind for flag, kind in _TORQUE_FLAGS.items() if unit and values[flag]),
        torque_unit_uNm=unit,
        input_kinds=tuple(kind for flag, kind in _INPUT_FLAGS.items() if input_unit and values[flag]),
        input_unit=input_unit,
        input_quantity=_quantity(values["input_quantity"]) if input_unit else None,
        major=values["major"],
        minor=values["minor"],
        schema_hash=values["schema_hash"],
    )


def _quantity(number: int) -> ArmQuantity:
    if number not in list(ArmQuantity):
        kinds = ", ".join(f"{kind.value} ({kind.name.lower()})" for kind in ArmQuantity)
        raise RemoteProtocolError(
            f"INFO page {ARM_PAGE} of the device has the input_quantity {number}, but an input of the arm is one of"
            f" {kinds}: correct the firmware"
        )
    return ArmQuantity(number)


def mismatch(protocol_page: Mapping[str, int]) -> VersionMismatch | None:
    """Return the reason why this host cannot communicate with a device, from INFO page 0; None if it can.

    In another major version, messages have other meanings. Another minor version only adds or lacks messages; both
    sides then use the common messages.
    """
    major, minor = protocol_page["major"], protocol_page["minor"]
    version = f"{PROTOCOL_VERSION[0]}.{PROTOCOL_VERSION[1]}"
    if major != PROTOCOL_VERSION[0]:
        return VersionMismatch(
            f"the device uses protocol {major}.{minor} and this dpr-lab {version}: {_upgrade(major)}"
        )
    if minor == PROTOCOL_VERSION[1] and protocol_page["schema_hash"] != SCHEMA_HASH:
        return VersionMismatch(
            f"the device and this dpr-lab both use protocol {version}, but from different dpr.dbc files"
            f" ({protocol_page['schema_hash']:08x} and {SCHEMA_HASH:08x}): flash the firmware built from the same"
            " dpr.dbc, or install the dpr-lab release that matches"
        )
    return None


def _upgrade(major: int) -> str:
    if major > PROTOCOL_VERSION[0]:
        return f"upgrade dpr-lab (or flash firmware of protocol {PROTOCOL_VERSION[0]}.x)"
    return f"flash newer firmware, of protocol {PROTOCOL_VERSION[0]}.x (or install a dpr-lab of protocol {major}.x)"
