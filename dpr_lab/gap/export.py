"""The corrected model for other programs: a plain Python module, and MuJoCo's MJCF.

The Python module holds the equation of motion with those effects that act on the rods and that a few lines can say;
what it cannot say is listed in its docstring. MJCF knows masses, inertias, damping, dry friction, springs and rotor
inertia; everything else is listed in a comment.
"""

from collections.abc import Mapping

from dpr_lab.model import Model
from dpr_lab.rig import Rig

TORQUES: Mapping[str, str] = {
    "coulomb_joint1": "pair1(-p['torque_Nm'] * np.tanh(u1 / 0.02))",
    "coulomb_joint2": "pair2(-p['torque_Nm'] * np.tanh(u2 / 0.02))",
    "stribeck_joint1": "pair1(stribeck(u1, p))",
    "stribeck_joint2": "pair2(stribeck(u2, p))",
    "viscous_ground_link2": "np.array([0.0, -p['friction_Nms'] * w2])",
    "air_drag_outer": "drag(t1, t2, w1, w2, p['coefficient_kg_per_m2'], inner=False)",
    "air_drag_both": "drag(t1, t2, w1, w2, p['coefficient_kg_per_m2'], inner=True)",
    "spring_joint1": "pair1(spring(q1, p))",
    "spring_joint2": "pair2(spring(q2, p))",
    "detent_joint1": "pair1(detent(q1, p))",
    "detent_joint2": "pair2(detent(q2, p))",
}
"""Effects that are torques of angles and speeds alone, in the words of the module; units and signs as in `effects`."""

_MODULE = '''"""Double pendulum {rig}: equation of motion with the effects that dpr-lab named.

theta1, theta2 are absolute angles, rad, 0 = upright, pi = hanging. Torques are relative to the scale of `BASE`.
{left_out}
"""

import numpy as np

L1, L2, G = {L1!r}, {L2!r}, {g!r}
BASE = {base!r}
EFFECTS = {effects!r}


def pair1(torque):
    """A torque of joint 1 on the inner rod."""
    return np.array([torque, 0.0])


def pair2(torque):
    """A torque of joint 2 on the outer rod; the inner one feels the reaction."""
    return np.array([-torque, torque])


def stribeck(u, p):
    more = p["extra_at_rest_Nm"] * np.exp(-((u / p["speed_rad_per_s"]) ** 2))
    return -(p["torque_Nm"] + more) * np.tanh(u / 0.02)


def spring(q, p):
    return -p["stiffness_Nm_per_rad"] * q - p["cubic_Nm_per_rad3"] * q**3


def detent(q, p):
    phase = p["order"] * q
    first = p["cos1_Nm"] * np.cos(phase) + p["sin1_Nm"] * np.sin(phase)
    return first + p["cos2_Nm"] * np.cos(2 * phase) + p["sin2_Nm"] * np.sin(2 * phase)


def drag(t1, t2, w1, w2, k, inner):
    s = (np.arange(64) + 0.5) * L2 / 64
    lever = L1 * np.cos(t1 - t2)
    v = lever * w1 + s * w2
    force = k * v * np.abs(v) * L2 / 64
    own = k * L1**4 / 4 * w1 * abs(w1) if inner else 0.0
    return -np.array([lever * force.sum() + own, (s * force).sum()])


def torques(theta1, theta2, omega1, omega2):
    """(2,) generalised torques of the effects, N m."""
    t1, t2, w1, w2 = theta1, theta2, omega1, omega2
    q1, q2, u1, u2 = t1 - np.pi, t2 - t1, w1, w2 - w1
    total = np.zeros(2)
{lines}
    return total


def derivative(t, x):
    """Time derivative of (theta1, theta2, omega1, omega2)."""
    theta1, theta2, omega1, omega2 = x
    a, b, d, e1, c1, c2 = BASE
    coupling, twist = d * np.cos(theta1 - theta2), d * np.sin(theta1 - theta2)
    friction = c2 * (omega2 - omega1)
    right = np.array(
        [
            -twist * omega2**2 - c1 * omega1 + friction + e1 * np.sin(theta1),
            twist * omega1**2 - friction + d * G / L1 * np.sin(theta2),
        ]
    )
    alphas = np.linalg.solve([[a, coupling], [coupling, b]], right + torques(theta1, theta2, omega1, omega2))
    return np.array([omega1, omega2, *alphas])


def simulate(x0, t, max_step=1e-3):
    """(n, 4) states at the instants t, by the classical Runge-Kutta rule."""
    x, states = np.array(x0, dtype=float), [np.array(x0, dtype=float)]
    for start, stop in zip(t[:-1], t[1:]):
        steps = max(1, int(np.ceil((stop - start) / max_step - 1e-9)))
        h = (stop - start) / steps
        for i in range(steps):
            now = start + i * h
            k1 = derivative(now, x)
            k2 = derivative(now + h / 2, x + h / 2 * k1)
            k3 = derivative(now + h / 2, x + h / 2 * k2)
            k4 = derivative(now + h, x + h * k3)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x.copy())
    return np.array(states)
'''


def python_module(model: Model, rig: Rig) -> str:
    """The corrected model as a self-contained module that needs numpy alone."""
    said = {name: values for name, values in model.effects.items() if name in TORQUES}
    lines = [f'    p = EFFECTS["{name}"]\n    total = total + {TORQUES[name]}' for name in said]
    return _MODULE.format(
        rig=model.rig.name,
        left_out=_left_out(model, tuple(TORQUES)),
        L1=model.rig.L1,
        L2=rig.rig.L2 or 2 * model.parameters["l2"].value,
        g=model.rig.g,
        base=tuple(model.base[name].value for name in ("a", "b", "d", "e1", "c1", "c2")),
        effects=said,
        lines="\n".join(lines),
    )


def _left_out(model: Model, said: tuple[str, ...]) -> str:
    missing = [name for name in model.effects if name not in said]
    return f"Not expressed here: {', '.join(missing)}." if missing else "All named effects are expressed."


IN_MJCF = (
    "coulomb_joint1",
    "coulomb_joint2",
    "spring_joint1",
    "spring_joint2",
    "rotor_inertia_joint1",
    "rotor_inertia_joint2",
)
"""Effects that MJCF has attributes for."""


def mjcf(model: Model, rig: Rig) -> str:
    """The corrected model as MJCF: two hinges, 0 = upright, joint 2 relative."""
    z = {name: item.value for name, item in model.parameters.items()}
    scale = model.base["b"].value / (z["J2"] + z["m2"] * z["l2"] ** 2)
    m1, m2, mb, J1, J2 = (scale * z[name] for name in ("m1", "m2", "mb", "J1", "J2"))
    c1, c2 = model.base["c1"].value, model.base["c2"].value
    L1, thin = model.rig.L1, 1e-6
    return f"""<mujoco model="{model.rig.name}">
  <!-- {_left_out(model, IN_MJCF)} Angles: 0 = upright; joint 2 is relative to the inner rod. -->
  <option gravity="0 0 {-model.rig.g:g}" timestep="0.0005" integrator="RK4"/>
  <worldbody>
    <body name="inner">
      <joint name="joint1" type="hinge" axis="0 1 0"{_attributes(model, 1, c1)}/>
      <inertial pos="0 0 {z["l1"]:.9g}" mass="{m1:.9g}" diaginertia="{J1:.9g} {J1:.9g} {thin:g}"/>
      <geom type="capsule" fromto="0 0 0 0 0 {L1:g}" size="0.006" contype="0" conaffinity="0"/>
      <body name="encoder2" pos="0 0 {L1:.9g}">
        <inertial pos="0 0 0" mass="{mb:.9g}" diaginertia="1e-9 1e-9 1e-9"/>
      </body>
      <body name="outer" pos="0 0 {L1:.9g}">
        <joint name="joint2" type="hinge" axis="0 1 0"{_attributes(model, 2, c2)}/>
        <inertial pos="0 0 {z["l2"]:.9g}" mass="{m2:.9g}" diaginertia="{J2:.9g} {J2:.9g} {thin:g}"/>
        <geom type="capsule" fromto="0 0 0 0 0 {rig.rig.L2 or 2 * z["l2"]:g}" size="0.006" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def _attributes(model: Model, joint: int, damping: float) -> str:
    found = {"damping": damping}
    effects = model.effects
    if (name := f"coulomb_joint{joint}") in effects:
        found["frictionloss"] = effects[name]["torque_Nm"]
    if (name := f"rotor_inertia_joint{joint}") in effects:
        found["armature"] = effects[name]["inertia_kgm2"]
    if (name := f"spring_joint{joint}") in effects:
        found["stiffness"] = effects[name]["stiffness_Nm_per_rad"]
        found["springref"] = 180.0 if joint == 1 else 0.0
    return "".join(f' {key}="{value:.9g}"' for key, value in found.items())
