"""MuJoCo's own system identification toolbox on a random rig's recordings."""

import contextlib
import io
from importlib import import_module
from typing import Any

import numpy as np
from _random_rigs import Array, Trial
from mujoco import sysid
from mujoco.sysid import SignalType, optimize

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.fitting.problem import Problem
from dpr_lab.identification.ratio_fit import segmented
from dpr_lab.rig import PARAMETERS, Rig

mujoco: Any = import_module("mujoco")  # its stubs are incomplete

STEP = 0.0025

RODS = """
<mujoco model="rods">
  <option integrator="RK4" timestep="{step}" gravity="0 0 -{g}"><flag contact="disable"/></option>
  <worldbody>
    <body name="inner">
      <joint name="joint1" type="hinge" axis="0 1 0"/>
      <inertial pos="0 0 0.2" mass="0.1" diaginertia="0.00133 0.00133 0.0005"/>
      <body name="encoder" pos="0 0 {L1}">
        <inertial pos="0 0 0" mass="0.208" diaginertia="1e-9 1e-9 1e-9"/>
      </body>
      <body name="outer" pos="0 0 {L1}">
        <joint name="joint2" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0.2" mass="0.1" diaginertia="0.00133 0.00133 0.0005"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="idle" joint="joint1"/></actuator>
</mujoco>
"""


def write(spec: Any, name: str, value: float) -> None:
    """Set one of the nine parameters in the MuJoCo model, whose rods lie along z."""
    kind, index = name[0], name[1]
    body = spec.body({"1": "inner", "2": "outer", "b": "encoder"}[index])
    if kind == "m":
        body.mass = value
    elif kind == "l":
        body.ipos = [0.0, 0.0, value]
    elif kind == "J":
        body.inertia = [value, value, value / 2]  # the third moment of inertia does not affect the swing
    else:
        coefficients = np.zeros_like(spec.joint(f"joint{index}").damping)  # a polynomial in speed since MuJoCo 4
        coefficients.flat[0] = value
        spec.joint(f"joint{index}").damping = coefficients


def parameters_of(rig: Rig) -> sysid.ParameterDict:
    """Return the nine parameters with the bounds of the box, each at the middle of its range."""
    declared = sysid.ParameterDict()
    for name, lower, upper in zip(PARAMETERS, *rig.bounds, strict=True):
        declared.add(
            sysid.Parameter(
                name,
                (lower + upper) / 2,
                lower,
                upper,
                modifier=lambda spec, parameter, name=name: write(spec, name, float(parameter.value[0])),
            )
        )
    return declared


def sequences(problem: Problem, states: Array, rig: Rig) -> sysid.ModelSequences:
    """Segments with their start states, in joint angles."""
    spec = mujoco.MjSpec.from_string(RODS.format(step=STEP, g=rig.g, L1=rig.L1))
    model = spec.compile()
    observed = [("joint1", SignalType.MjStateQPos), ("joint2", SignalType.MjStateQPos)]
    starts, idle, angles = [], [], []
    cuts, of_rods = problem.segments.offsets[1:-1], problem.joints.of_rods
    for instants, joints, start in zip(
        np.split(problem.t, cuts), np.split(problem.measured, cuts), states, strict=True
    ):
        t = instants - instants[0]
        starts.append(sysid.create_initial_state(model, of_rods(start[:2]), of_rods(start[2:])))
        idle.append(sysid.TimeSeries(t, np.zeros((len(t), 1))))
        angles.append(sysid.TimeSeries.from_names(t, joints, model, observed))
    names = [f"segment {i}" for i in range(len(states))]
    return sysid.ModelSequences("rods", spec, names, starts, idle, angles, allow_missing_sensors=True)


def toolbox(trial: Trial, rig: Rig, length: float) -> Array:
    """Estimate the ratios (5,) with the toolbox."""
    problem, states = segmented(trial.runs, rig, length)
    residual = sysid.build_residual_fn(models_sequences=[sequences(problem, states, rig)])
    with contextlib.redirect_stdout(io.StringIO()):  # it prints every iteration
        result, _ = optimize(parameters_of(rig), residual, verbose=False, max_iters=60)
    Z = np.array([result[name].value[0] for name in PARAMETERS])
    return ratios(base_parameters(Z, rig.L1, rig.g))
