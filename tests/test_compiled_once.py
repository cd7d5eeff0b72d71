"""Worker processes wait for the files that the first worker compiles."""

import threading
import time
from pathlib import Path
from typing import Any

from tests.compiled_once import one_after_the_other
from tests.one_compiler import place_of


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


def test_the_same_kernel_of_two_copies_of_the_repository_is_not_waited_for() -> None:
    def kernel_of(folder: str) -> Any:
        space: dict[str, Any] = {"__name__": "dpr_lab.kernels"}
        exec(compile("def step(): pass", f"{folder}/dpr_lab/kernels.py", "exec"), space)
        return space["step"]

    assert place_of(kernel_of("one")) == place_of(kernel_of("one"))
    assert place_of(kernel_of("one")) != place_of(kernel_of("other"))
