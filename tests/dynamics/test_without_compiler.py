"""NUMBA_DISABLE_JIT=1: the kernels run as Python functions."""

import os
import subprocess
import sys

import pytest

from dpr_lab.dynamics.simulate import simulate

BASE, START, INSTANTS = (0.05, 0.005, 0.008, 1.4, 0.001, 0.001), (1.0, 2.0, 0.0, 0.0), (0.0, 0.02)
SCRIPT = f"""
import dpr_lab.gap.diagnose
from dpr_lab.dynamics.simulate import simulate
print(float(simulate({BASE}, 0.4, 9.81, {START}, {INSTANTS}, 1e-3)[-1, 0]))
"""


@pytest.mark.slow
def test_the_python_functions_give_the_result_of_the_compiled_ones():
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True)
    compiled = simulate(BASE, 0.4, 9.81, START, INSTANTS, 1e-3)[-1, 0]
    assert float(run.stdout) == pytest.approx(compiled, rel=1e-12)
