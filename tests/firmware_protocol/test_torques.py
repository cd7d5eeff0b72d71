"""Torques are assigned to the samples of the same tick; missing torques are counted."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from firmware_protocol.device_role import DeviceSession
from firmware_protocol.errors import RemoteProtocolError
from firmware_protocol.host_role import HostSession
from firmware_protocol.identity import ARM_PAGE, DeviceInfo, assemble, info_pages
from firmware_protocol.messages import ArmInput, ArmQuantity, Hello, Info, Sample, Torque, TorqueKind, decode, encode
from firmware_protocol.stream import Row
from firmware_protocol.torques import DrivenRow, TorquePairs

PLAIN = DeviceInfo("1.0.0", "00000000000000ff", (16384, 16384, 16384), 4000, 100)
DRIVEN = DeviceInfo(
    "1.0.0", "00000000000000ff", (16384, 16384, 16384), 4000, 100, torque_kinds=tuple(TorqueKind), torque_unit_uNm=100
)
WITH_ARM = replace(PLAIN, input_kinds=tuple(TorqueKind), input_unit=50, input_quantity=ArmQuantity.CURRENT)
MEASURED, COMMANDED = TorqueKind
TICKS = range(65530, 65545)
"""Ticks around an overflow of the low 16 bits."""


def rows(ticks: Iterable[int] = TICKS) -> list[Row]:
    return [Row(tick, (tick, 0, 0)) for tick in ticks]


def torque_at(tick: int, kind: TorqueKind = MEASURED) -> Torque:
    return Torque(kind, tick & 0xFFFF, tick - 65530, -kind)


def paired(kinds, happenings) -> tuple[list[DrivenRow], int]:
    pairs = TorquePairs(kinds)
    pairs.take(rows([65529]))
    result: list[DrivenRow] = []
    for happening in happenings:
        if isinstance(happening, Row):
            result += pairs.take([happening])
        else:
            pairs.note(happening)
    return result + pairs.rest(), pairs.missing - 1


def test_every_sample_gets_the_torques_of_its_own_tick_in_any_order_nearby():
    usual = [entry for row in rows() for entry in (row, torque_at(row.tick), torque_at(row.tick, COMMANDED))]
    swapped = [usual[i ^ 1] if i ^ 1 < len(usual) else usual[i] for i in range(len(usual))]
    expected = [DrivenRow(t, (t, 0, 0), ((t - 65530, -1), (t - 65530, -2))) for t in TICKS]
    for happenings in (usual, swapped):
        assert paired(TorqueKind, happenings) == (expected, 0)
    assert paired([MEASURED], usual)[0][3] == DrivenRow(65533, (65533, 0, 0), ((3, -1),))


def test_a_sample_without_its_torque_is_left_out_and_counted():
    lost, contradicted = 65534, 65540
    happenings = [entry for row in rows() for entry in (row, *([] if row.tick == lost else [torque_at(row.tick)]))]
    happenings.insert(-8, Torque(MEASURED, contradicted & 0xFFFF, 999, 0))
    result, missing = paired([MEASURED], happenings)
    assert [row.tick for row in result] == [t for t in TICKS if t not in (lost, contradicted)]
    assert missing == 2


def test_the_identity_contains_the_drives_and_is_unchanged_without_drives():
    assert assemble(info_pages(DRIVEN)) == DRIVEN
    assert [page.page for page in info_pages(DRIVEN)] == [8, *range(8)]
    assert [page.page for page in info_pages(PLAIN)] == [*range(8)]
    late = HostSession()
    pages = DeviceSession(DRIVEN).receive(late.hello(0.0), 0.0).frames
    for frame in (*pages[:1], *pages[2:], pages[1]):
        late.receive(frame)
    assert late.info == DRIVEN


def test_the_identity_contains_the_drive_of_the_arm_and_older_devices_are_accepted():
    assert assemble(info_pages(WITH_ARM)) == WITH_ARM
    assert [page.page for page in info_pages(WITH_ARM)] == [9, *range(8)]
    for info in (replace(PLAIN, minor=0, schema_hash=1), replace(DRIVEN, minor=1, schema_hash=2)):
        host, device = HostSession(), DeviceSession(info)
        for frame in device.receive(host.hello(0.0), 0.0).frames:
            host.receive(frame)
        assert host.info == info


def test_every_sample_gets_the_input_of_the_arm_of_its_own_tick():
    usual = [entry for row in rows() for entry in (row, ArmInput(MEASURED, row.tick & 0xFFFF, 65530 - row.tick))]
    assert paired([MEASURED], usual) == ([DrivenRow(t, (t, 0, 0), ((65530 - t, 0),)) for t in TICKS], 0)


def test_the_device_clips_torques_beyond_its_range_and_accepts_no_torque_command():
    session = DeviceSession(DRIVEN)
    session.receive(encode(Hello(1)), 0.0)
    assert decode(session.torque(COMMANDED, 65537, (40000, -40000))) == Torque(COMMANDED, 1, 32767, -32768)
    answer = session.receive(session.torque(COMMANDED, 0, (1, 1)), 0.0)
    assert (answer.frames, answer.task) == ((), None)
    assert isinstance(decode(session.sample(1, (0, 0, 0))), Sample)


def test_codes_of_kinds_and_quantities_in_the_protocol_do_not_change() -> None:
    assert {kind.name: kind.value for kind in TorqueKind} == {"MEASURED": 1, "COMMANDED": 2}
    assert {quantity.name: quantity.value for quantity in ArmQuantity} == {"TORQUE": 1, "CURRENT": 2, "VOLTAGE": 3}


def test_an_input_of_the_arm_without_its_quantity_ends_the_handshake_with_the_reason():
    pages = [
        Info(page.page, {**page.fields, "input_quantity": 0}) if page.page == ARM_PAGE else page
        for page in info_pages(WITH_ARM)
    ]
    with pytest.raises(RemoteProtocolError, match=r"input_quantity 0, but .* 1 \(torque\), 2 \(current\)"):
        assemble(pages)


def test_a_sample_waits_for_its_torque_during_two_later_samples_and_a_torque_is_kept_for_64_ticks():
    pairs = TorquePairs([MEASURED])
    assert [pairs.take([row]) for row in rows(range(2))] == [[], []]
    pairs.note(Torque(MEASURED, 0, 5, 6))
    assert pairs.take(rows([2])) == [DrivenRow(0, (0, 0, 0), ((5, 6),))]
    assert (pairs.take(rows([3])), pairs.missing) == ([], 1)
    pairs.restart()
    for tick in range(65):
        pairs.note(Torque(MEASURED, tick, tick, 0))
    assert [row.tick for row in pairs.take(rows(range(65))) + pairs.rest()] == [*range(1, 65)]
    assert pairs.missing == 2


def test_torques_of_a_new_stream_are_assigned_to_its_own_ticks():
    pairs = TorquePairs([MEASURED])
    pairs.note(Torque(MEASURED, 1, 9, 9))
    pairs.take(rows([40_000]))
    pairs.restart()
    pairs.note(Torque(MEASURED, 0, 1, 2))
    assert pairs.take(rows(range(2))) + pairs.rest() == [DrivenRow(0, (0, 0, 0), ((1, 2),))]
    assert pairs.missing == 1
