import numpy as np
import pytest

from dpr_lab.joint_angles import JointAngles
from dpr_lab.rig import load_rig

THETA = np.array([[0.3, 2.9], [-1.0, 7.0], [np.pi, np.pi]])


@pytest.mark.parametrize("relative", [True, False])
def test_joint_angles_and_rod_angles_are_each_others_inverse(relative):
    joints = JointAngles(relative)
    np.testing.assert_allclose(joints.to_rods(joints.of_rods(THETA)), THETA, rtol=1e-15)
    np.testing.assert_allclose(joints.of_rods(THETA) @ joints.to_rods_matrix.T, THETA, rtol=1e-15)


def test_an_encoder_on_the_joint_reads_the_angle_between_the_rods():
    assert JointAngles(True).of_rods([0.3, 0.5]).tolist() == pytest.approx([0.3, 0.2])
    assert JointAngles(False).of_rods([0.3, 0.5]).tolist() == [0.3, 0.5]


@pytest.mark.parametrize("joint2", ["relative", "absolute"])
def test_counts_are_zero_where_the_rods_hang_and_follow_the_angles(joint2):
    rig = load_rig("paper")
    rig = rig.model_copy(update={"encoders": rig.encoders.model_copy(update={"joint2": joint2})})
    assert rig.positions([0.0, np.pi, np.pi]).tolist() == [0.0, 0.0, 0.0]
    swung = np.column_stack([[0.1, 0.2, 0.3], THETA])
    np.testing.assert_allclose(rig.theta(rig.positions(swung)), swung, rtol=1e-13)
