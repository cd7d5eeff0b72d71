"""Ports and buses with different programs at the other end."""

from pathlib import Path

import pytest

UID = 0xBEEF_0000_0042


def plug(folder: Path, name: str, url: str) -> None:
    """Make a served port appear under a name of its own, as udev does."""
    path = url.partition("?")[0].removeprefix("can://slcan").removeprefix("serial://")
    (folder / name).symlink_to(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shown", "link", "prefix"),
    [("serial", "pty", "serial://"), pytest.param("CAN", "slcan", "can://slcan", marks=pytest.mark.long)],
)
def test_a_device_is_found_again_on_another_port_by_its_uid(
    shown: str, link: str, prefix: str, serve, operate, wrong_samples, tmp_path, matrix
) -> None:
    anywhere = f"{prefix}{tmp_path}/tty*?uid={UID:x}"
    plug(tmp_path, "ttyB", serve(link=link, uid=0xBEEF_0000_0041))
    plug(tmp_path, "ttyC", serve(link=link, uid=UID, fault=("cut_after_s=20",)))
    lost = operate(anywhere, "--duration", "60")
    assert lost.code == 7, lost.message
    assert wrong_samples(lost.runs[0]) == 0
    (tmp_path / "ttyC").unlink()
    plug(tmp_path, "ttyA", serve(link=link, uid=UID))
    result = operate(anywhere, "--duration", "1", out=tmp_path / "again")
    assert result.code == 0, result.message
    assert wrong_samples(result.runs[0]) == 0
    matrix.show("replugged on another port, link with `uid=`", shown, result.message, result.code, "every sample")


@pytest.mark.slow
def test_a_device_is_found_on_another_channel_of_a_backend(serve, operate, wrong_samples, tmp_path, matrix) -> None:
    serve(link="virtual:uid-here", uid=0xBEEF_0000_0041)
    serve(link="virtual:uid-there", uid=UID)
    for release, link in enumerate(("can://virtual", "can://virtual/uid-*", "can://virtual/uid-there"), 1):
        result = operate(f"{link}?uid={UID:x}", "--duration", "1", out=tmp_path / str(release))
        assert result.code == 0, result.message
        assert wrong_samples(result.runs[0], release=release) == 0
    matrix.show("on another channel, link with `uid=`", "virtual CAN", result.message, result.code, "every sample")
    lost = operate(f"can://virtual/uid-here?uid={UID:x}")
    assert lost.code == 4
    assert "searched uid-here (device 0000beef00000041)" in lost.message


def test_an_unknown_uid_is_reported_with_the_devices_found(serve, operate, tmp_path, matrix) -> None:
    plug(tmp_path, "ttyA", serve(uid=0xBEEF_0000_0041))
    done = operate(f"serial://{tmp_path}/tty*?uid=dead")
    assert done.code == 4
    assert "device 0000beef00000041" in done.message
    matrix.show("the UID on no port", "serial", done.message, done.code, "no RELEASE sent, no file created")


@pytest.mark.parametrize("uid", ["", "xyz", "12", "0" * 17])
def test_an_invalid_uid_is_refused(operate, uid: str) -> None:
    done = operate(f"serial://?uid={uid}")
    assert done.code == 2
    assert "is neither the UID of a device" in done.message


@pytest.mark.parametrize(
    ("link", "rate", "wrong"), [("serial", 115_200, "baud=921600"), ("CAN", 500_000, "bitrate=1000000")]
)
def test_another_bit_rate(serve, operate, matrix, link: str, rate: int, wrong: str) -> None:
    url = serve(link={"serial": "pty", "CAN": "slcan"}[link], baud=rate)
    done = operate(url.partition("?")[0] + "?" + wrong)
    assert (done.code, done.runs) == (4, [])
    matrix.show("another bit rate set", link, done.message, done.code, "no RELEASE sent, no file created")


def test_two_devices_under_one_node(serve, operate, matrix) -> None:
    serve(link="virtual:two", uid=1)
    done = operate(serve(link="virtual:two", uid=2))
    assert (done.code, done.runs) == (4, [])
    matrix.show("two devices on one bus", "virtual CAN", done.message, done.code, "no RELEASE sent, no file created")
