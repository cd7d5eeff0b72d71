"""Rig with a moving arm in MuJoCo, without code of the package: three hinges, slender rods, one motor."""

import numpy as np

Z = np.array([0.21, 0.19, 0.11, 0.09, 0.2, 0.0011, 0.0009, 0.0014, 0.0012])
L0, L1, G = 0.3, 0.4, 9.81
FRAME = (L0, L1, G)

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.0005" gravity="{gx!r} {gy!r} {g!r}" integrator="RK4"/>
  <worldbody><body>
    <joint type="hinge" axis="0 0 1" damping="{c0!r}" stiffness="{k0!r}"/>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="{J0!r} {J0!r} {J0!r}"/>
    <body pos="{L0!r} 0 0">
      <joint type="hinge" axis="-1 0 0" damping="{c1!r}"/>
      <inertial pos="0 0 {l1!r}" mass="{m1!r}" diaginertia="{J1!r} {J1!r} 1e-12"/>
      <body pos="0 0 {L1!r}">
        <inertial pos="0 0 0" mass="{mb!r}" diaginertia="1e-12 1e-12 1e-12"/>
      </body>
      <body pos="0 0 {L1!r}">
        <joint type="hinge" axis="-1 0 0" damping="{c2!r}"/>
        <inertial pos="0 0 {l2!r}" mass="{m2!r}" diaginertia="{J2!r} {J2!r} 1e-12"/>
      </body>
    </body>
  </body></worldbody>
</mujoco>
"""


def three_hinges(mujoco, Z, arm, start, t, push, frame=FRAME, across=(0.0, 0.0)):
    """(n, 3) theta0, theta1, theta2 of a swing at even instants, with a torque on the arm held between them.

    `across` is the horizontal part of gravity, m/s^2, along the arm at its zero and across it.
    """
    names = ("l1", "l2", "m1", "m2", "mb", "c1", "c2", "J1", "J2")
    values = dict(zip(names, map(float, Z), strict=True))
    of_arm = {"J0": arm.J0, "c0": arm.c0, "k0": arm.k0}
    gravity = {"gx": across[0], "gy": across[1], "g": -frame[2]}
    model = mujoco.MjModel.from_xml_string(MODEL.format(**values, **of_arm, L0=frame[0], L1=frame[1], **gravity))
    data = mujoco.MjData(model)
    data.qpos[:] = start[0], start[1], start[2] - start[1]
    data.qvel[:] = start[3], start[4], start[5] - start[4]
    substeps = round((t[1] - t[0]) / model.opt.timestep)
    theta = np.empty((len(t), 3))
    for i, torque in enumerate(push):
        theta[i] = data.qpos[0], data.qpos[1], data.qpos[1] + data.qpos[2]
        data.qfrc_applied[0] = torque
        for _ in range(substeps):
            mujoco.mj_step(model, data)
    return theta
