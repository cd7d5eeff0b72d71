"""The same exchanges with every implementation of the protocol."""

import json
from pathlib import Path

import pytest

import firmware_protocol
from tests.thinned import FULL

RECORDED = json.loads(Path(firmware_protocol.__file__).with_name("traces.json").read_text(encoding="utf-8"))
TRACES = {trace["why"]: trace for trace in RECORDED["traces"]}


@pytest.mark.parametrize("why", TRACES)
def test_the_python_role(why, python_role, run_trace):
    run_trace(python_role(TRACES[why].get("drives", "")), TRACES[why]["steps"])


@pytest.mark.parametrize("why", TRACES)
def test_the_c_core(why, c_role, run_trace):
    run_trace(c_role(TRACES[why].get("drives", "")), TRACES[why]["steps"])


@pytest.mark.slow
def test_the_c_core_on_a_cortex_m(qemu_role, run_trace):
    for trace in list(TRACES.values())[:: 1 if FULL else 4]:  # the core is the same as above, only slower
        if "drives" not in trace:  # of which this board has none
            qemu_role.switch_on()
            run_trace(qemu_role, trace["steps"])
