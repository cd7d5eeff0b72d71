"""Worker processes wait for the files that the first worker compiles."""

import threading
import time
from pathlib import Path

from tests.compiled_once import one_after_the_other


def test_the_others_begin_after_the_first_has_ended(tmp_path: Path) -> None:
    place, order = tmp_path / "lock", list[str]()

    def collect() -> None:
        with one_after_the_other("gw1", place):
            order.append("gw1")

    other = threading.Thread(target=collect)
    with one_after_the_other("gw0", place):
        other.start()
        time.sleep(0.2)
        order.append("gw0")
    other.join()
    assert order == ["gw0", "gw1"]


def test_a_first_worker_that_failed_does_not_keep_the_others(tmp_path: Path) -> None:
    (tmp_path / "lock").touch()
    with one_after_the_other("gw1", tmp_path / "lock"):
        pass
