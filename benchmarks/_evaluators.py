"""Other implementations of E(Z), docs/theory.md equation (2), for comparison with the batch evaluator.

Each function takes a `Problem` and returns an evaluator: a function that returns the costs of the first n candidates,
summed over poses. All evaluators except `solve_ivp` use the same Runge-Kutta steps. Each uses one thread.
"""

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters, rows
from dpr_lab.dynamics.equation import accelerations
from dpr_lab.dynamics.prediction import predict_batch
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.rollout import trajectory_errors
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import effect_params
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.rig import PARAMETERS, load_rig
from dpr_lab.setup import Setup

STEP, SAMPLES = 0.005, 2001

Array = NDArray[np.float64]
Evaluator = Callable[[int], Array]


@dataclass(frozen=True, slots=True)
class Problem:
    """Candidates, poses, and the trajectories with which each candidate is compared."""

    parameters: Array
    """(n, 9) parameters of each candidate, SI units."""
    candidates: Array
    """(n, 6) constants of each candidate that the kernels use."""
    poses: Array
    """(poses, 4) start states, rad and rad/s."""
    reference: Array
    """(poses, samples, 4) trajectories of the nominal parameters, rad and rad/s."""


def problem(candidates: int, samples: int = SAMPLES, repeats: int = 1) -> Problem:
    """Random candidates within the bounds of the rig `paper`, and its three poses, `repeats` times."""
    rig = load_rig("paper")
    L1, g = rig.rig.L1, rig.rig.g
    poses = np.array([[*pose.theta[1:], 0.0, 0.0] for pose in rig.poses.values()])
    t = STEP * np.arange(samples)
    base = base_parameters(rig.nominal, L1, g)
    reference = np.array([simulate(base, L1, g, pose, t, STEP) for pose in poses])
    drawn = np.random.default_rng(0).uniform(*rig.bounds, size=(candidates, len(PARAMETERS)))
    known = rows(base_parameters(drawn, L1, g), L1, g)
    return Problem(drawn, known, np.tile(poses, (repeats, 1)), np.tile(reference, (repeats, 1, 1)))


def lanes(task: Problem) -> Evaluator:
    """Create an evaluator from the batch simulation of dpr-lab."""
    return lambda n: trajectory_errors(task.candidates[:n], task.poses, task.reference, STEP).sum(axis=1)


def predictions(task: Problem, *, arm: bool) -> Evaluator:
    """Create a function that computes the predicted readings of all poses as in a fit, with the arm clamped or free."""
    rig = load_rig("paper")
    bases = base_parameters(task.parameters, rig.L1, rig.g)
    t = STEP * np.arange(task.reference.shape[1])
    runs = range(len(task.poses))
    laid_out = segments([t] * len(runs), runs, [Setup(arm_moves=arm)] * len(runs), step=STEP)
    initial = np.pad(task.poses, ((0, 0), (0, 2 if arm else 0)))
    params = effect_params({FREE_ARM.name: {"inertia_kgm2": 0.15, "viscous_Nms": 0.02}} if arm else {})

    def evaluate(n: int) -> Array:
        starts = np.broadcast_to(initial, (n, *initial.shape))
        return predict_batch(bases[:n], np.tile(params, (n, 1)), rig_constants(rig), laid_out, starts, arm=arm)

    return evaluate


def scalar_loop(task: Problem) -> Evaluator:
    """Create an evaluator that processes one candidate after another in a loop compiled by Numba."""
    return lambda n: _scalar_costs(task.candidates[:n], task.poses, task.reference)


@numba.njit(error_model="numpy")
def _scalar_costs(candidates: Array, poses: Array, reference: Array) -> Array:
    costs = np.zeros(len(candidates))
    h = STEP
    for i in range(len(candidates)):
        b, d, e1, e2, c1, c2 = candidates[i]
        for p in range(len(poses)):
            x, y, v, w = poses[p]
            for k in range(1, reference.shape[1]):
                a1, a2 = accelerations(x, y, v, w, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                v2, w2 = v + h / 2 * a1, w + h / 2 * a2
                b1, b2 = accelerations(x + h / 2 * v, y + h / 2 * w, v2, w2, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                v3, w3 = v + h / 2 * b1, w + h / 2 * b2
                g1, g2 = accelerations(x + h / 2 * v2, y + h / 2 * w2, v3, w3, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                v4, w4 = v + h * g1, w + h * g2
                k1, k2 = accelerations(x + h * v3, y + h * w3, v4, w4, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                x, y = x + h / 6 * (v + 2 * (v2 + v3) + v4), y + h / 6 * (w + 2 * (w2 + w3) + w4)
                v, w = v + h / 6 * (a1 + 2 * (b1 + g1) + k1), w + h / 6 * (a2 + 2 * (b2 + g2) + k2)
                z = reference[p, k]
                costs[i] += (x - z[0]) ** 2 + (y - z[1]) ** 2 + (v - z[2]) ** 2 + (w - z[3]) ** 2
    return costs


def numpy_batch(task: Problem) -> Evaluator:
    """Create an evaluator that processes all candidates and poses as one NumPy array."""

    def run(n: int) -> Array:
        b, d, e1, e2, c1, c2 = task.candidates[:n].T[:, :, None]

        def slope(x: Array) -> Array:
            t1, t2, w1, w2 = x
            coupling, whirl, drag = d * np.cos(t1 - t2), d * np.sin(t1 - t2), c2 * (w1 - w2)
            f1 = -whirl * w2 * w2 - c1 * w1 - drag + e1 * np.sin(t1)
            f2 = whirl * w1 * w1 + drag + e2 * np.sin(t2)
            scale = 1.0 / (b - coupling * coupling)
            return np.stack([w1, w2, (b * f1 - coupling * f2) * scale, (f2 - coupling * f1) * scale])

        x = np.broadcast_to(task.poses.T[:, None, :], (4, n, len(task.poses)))
        costs = np.zeros(x.shape[1:])
        for target in task.reference.transpose(1, 2, 0)[1:]:
            k1 = slope(x)
            k2 = slope(x + STEP / 2 * k1)
            k3 = slope(x + STEP / 2 * k2)
            k4 = slope(x + STEP * k3)
            x = x + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
            costs += ((x - target[:, None, :]) ** 2).sum(axis=0)
        return costs.sum(axis=1)

    return run


def solve_ivp(task: Problem, tolerance: float) -> Evaluator:
    """Create an evaluator that simulates one candidate after another with SciPy's adaptive solver, in plain Python."""
    from scipy.integrate import solve_ivp as integrate

    t = STEP * np.arange(task.reference.shape[1])

    def swing(candidate: Array, pose: Array) -> Array:
        b, d, e1, e2, c1, c2 = candidate.tolist()

        def slope(_: float, x: Array) -> tuple[float, ...]:
            t1, t2, w1, w2 = x.tolist()
            coupling, whirl, drag = d * math.cos(t1 - t2), d * math.sin(t1 - t2), c2 * (w1 - w2)
            f1 = -whirl * w2 * w2 - c1 * w1 - drag + e1 * math.sin(t1)
            f2 = whirl * w1 * w1 + drag + e2 * math.sin(t2)
            scale = 1.0 / (b - coupling * coupling)
            return w1, w2, (b * f1 - coupling * f2) * scale, (f2 - coupling * f1) * scale

        return integrate(slope, (0.0, t[-1]), pose, "RK45", t, rtol=tolerance, atol=tolerance)["y"].T

    def run(n: int) -> Array:
        poses = list(zip(task.poses, task.reference, strict=True))
        return np.array([sum(((swing(z, x) - y) ** 2).sum() for x, y in poses) for z in task.candidates[:n]])

    return run


def c_program(task: Problem, source: Path, *flags: str) -> Evaluator | None:
    """Compile the C program for comparison on this machine; None without its source or gcc.

    The program evaluates only problems of the full duration.
    """
    compiler = shutil.which("gcc")
    if compiler is None or not source.is_file():
        return None
    options = ["-O3", "-march=native", "-mprefer-vector-width=512", "-fopenmp", "-shared", "-fPIC", "-DW=32", *flags]
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "limit.so"
        subprocess.run([compiler, *options, "-o", library, source, "-lm"], check=True)
        evaluate = ctypes.CDLL(str(library)).evalb
    evaluate.argtypes = [ctypes.c_void_p, ctypes.c_long, *[ctypes.c_void_p] * 3, ctypes.c_int]

    def run(n: int) -> Array:
        columns, costs = np.ascontiguousarray(task.candidates[:n].T), np.empty(n)
        pointers = [array.ctypes.data for array in (task.reference, task.poses, costs)]
        evaluate(columns.ctypes.data, n, *pointers, 1)
        return costs

    return run


RODS = """
<mujoco>
  <option integrator="RK4" timestep="{step}" gravity="0 0 -{g}"><flag contact="disable"/></option>
  <worldbody>
    <body>
      <joint type="hinge" axis="0 1 0" damping="{c1}"/>
      <inertial pos="0 0 {l1}" mass="{m1}" diaginertia="{J1} {J1} {J1}"/>
      <body pos="0 0 {L1}"><inertial pos="0 0 0" mass="{mb}" diaginertia="1e-12 1e-12 1e-12"/></body>
      <body pos="0 0 {L1}">
        <joint type="hinge" axis="0 1 0" damping="{c2}"/>
        <inertial pos="0 0 {l2}" mass="{m2}" diaginertia="{J2} {J2} {J2}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def mujoco_rollout(task: Problem, most: int) -> Evaluator | None:
    """Create an evaluator with MuJoCo's batch rollout of at most `most` models; None if MuJoCo is not installed.

    The models are built in this call, before any evaluation.
    """
    try:
        mujoco: Any = import_module("mujoco")
        rollout: Any = import_module("mujoco.rollout").rollout
    except ImportError:
        return None
    rig = load_rig("paper")
    values = [dict(zip(PARAMETERS, Z.tolist(), strict=True)) for Z in task.parameters[:most]]
    texts = [RODS.format(step=STEP, g=rig.rig.g, L1=rig.rig.L1, **value) for value in values]
    models = [mujoco.MjModel.from_xml_string(text) for text in texts]
    data = mujoco.MjData(models[0])
    # A state in MuJoCo: time, joint angles, joint speeds, with the outer rod relative to the inner one.
    starts = np.column_stack([np.zeros(len(task.poses)), task.poses @ _RELATIVE.T])

    def run(n: int) -> Array:
        repeated = [model for model in models[:n] for _ in task.poses]
        states, _ = rollout(repeated, data, np.tile(starts, (n, 1)), nstep=task.reference.shape[1] - 1)
        swings = (states[:, :, 1:] @ np.linalg.inv(_RELATIVE).T).reshape(n, len(task.poses), -1, 4)
        return ((swings - task.reference[:, 1:]) ** 2).sum(axis=(1, 2, 3))

    return run


_RELATIVE = np.array([[1.0, 0, 0, 0], [-1, 1, 0, 0], [0, 0, 1, 0], [0, 0, -1, 1]])
