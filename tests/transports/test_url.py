import subprocess
import sys

import pytest

from dpr_lab.errors import LinkError
from dpr_lab.transports import TRANSPORTS, open_transport
from dpr_lab.transports.transport import Capacity
from dpr_lab.transports.url import one_of, parse_url, seconds, whole_number


def test_url_keeps_case_of_windows_ports_and_splits_device_paths() -> None:
    assert parse_url("serial://COM3?baud=9600").host == "COM3"
    can = parse_url("can://slcan/dev/pts/5?bitrate=1000000")
    assert (can.scheme, can.host, can.path, can.query) == ("can", "slcan", "/dev/pts/5", (("bitrate", "1000000"),))


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("bud=9600", "unknown option 'bud' (options of this kind of link: baud)"),
        ("baud=fast", "baud = 'fast': is not a positive whole number"),
        ("baud=0", "is not a positive whole number"),
        ("baud=-5", "is not a positive whole number"),
        ("baud=", "is not a positive whole number"),
        ("baud=²", "is not a positive whole number"),
        ("baud=1&baud=2", "option 'baud' is given twice"),
    ],
)
def test_wrong_option_is_named(query: str, sentence: str) -> None:
    with pytest.raises(LinkError) as caught:
        parse_url(f"serial:///dev/ttyUSB0?{query}").options({"baud": whole_number})
    assert sentence in str(caught.value)
    assert str(caught.value).startswith("serial:///dev/ttyUSB0?")


@pytest.mark.parametrize("text", ["/dev/ttyUSB0", "COM3", "", "serial:///dev/ttyUSB0?baud", "serial://[::1"])
def test_the_message_on_an_invalid_url_contains_an_example(text: str) -> None:
    with pytest.raises(LinkError, match=r"is not a link URL.*://"):
        parse_url(text)


@pytest.mark.parametrize(
    ("name", "link"),
    [
        ("/dev/ttyS0", "serial:///dev/ttyS0?baud=921600"),
        ("COM3", "serial://COM3?baud=921600"),
        ("can0", "can://socketcan/can0?bitrate=1000000"),
    ],
)
def test_the_link_of_a_port_or_interface_is_in_the_message(name: str, link: str) -> None:
    with pytest.raises(LinkError) as caught:
        parse_url(name)
    assert f"use for example {link}," in str(caught.value)
    assert parse_url(link).scheme in link


def test_readers_of_values() -> None:
    assert seconds("0.5") == 0.5
    for text in ("-1", "nan", "inf", "soon"):
        with pytest.raises(ValueError, match="is not a time in seconds"):
            seconds(text)
    with pytest.raises(ValueError, match="is not one of pty, can"):
        one_of("pty", "can")("usb")


def test_unknown_scheme_lists_an_example_of_every_known_one() -> None:
    with pytest.raises(LinkError) as caught:
        open_transport("usb://stick")
    assert all(kind.example in str(caught.value) for kind in TRANSPORTS.values())


def test_every_transport_has_an_example_of_its_own_scheme() -> None:
    assert all(parse_url(kind.example).scheme == scheme for scheme, kind in TRANSPORTS.items())


@pytest.mark.parametrize("scheme", TRANSPORTS)
def test_every_transport_refuses_an_unknown_option(scheme: str) -> None:
    place = {"can": "virtual/x", "socket": "127.0.0.1:1"}.get(scheme, "")
    with pytest.raises(LinkError, match="unknown option 'colour'"):
        open_transport(f"{scheme}://{place}?colour=red")


def test_rate_that_fits_passes_and_one_hertz_more_is_refused_with_the_arithmetic() -> None:
    capacity = Capacity("115200 baud", 115_200, 140, "921600 baud")
    assert capacity.max_rate_hz == 658
    capacity.check(658)
    with pytest.raises(LinkError, match="659 Hz needs 92,260 bit/s, 80 % of 115200 baud"):
        capacity.check(659)
    with pytest.raises(LinkError) as caught:
        capacity.check(1000)
    assert str(caught.value) == (
        "1000 Hz needs 140,000 bit/s, 122 % of 115200 baud (at most 80 % may be used):"
        " choose at most 658 Hz or 921600 baud"
    )


def test_importing_the_package_imports_no_large_library() -> None:
    code = (
        "import sys, dpr_lab.transports; print([m for m in ('can', 'cantools', 'serial', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
