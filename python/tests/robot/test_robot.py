"""palpate.Robot against pinocchio (SKIPPED by name without `pin`), and in scenes against single spheres."""

import numpy as np
import pytest

import palpate

URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><collision><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.08 0.3"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.2"/></geometry></collision></link>
<link name="left"><collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision></link>
<link name="right"><collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><origin xyz="0 0.1 0" rpy="-1.5 0.2 0.1"/><parent link="base"/><child link="upper"/>
  <axis xyz="1 0.2 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><origin xyz="0 0 0.3" rpy="0.1 0 0.4"/><parent link="upper"/><child link="fore"/>
  <axis xyz="1 0 0.3"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="finger" type="prismatic"><origin xyz="0 0.01 0.22"/><parent link="fore"/><child link="left"/>
  <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
<joint name="other" type="prismatic"><origin xyz="0 -0.01 0.22"/><parent link="fore"/><child link="right"/>
  <axis xyz="0 1 0"/><limit lower="-0.04" upper="0" effort="1" velocity="1"/><mimic joint="finger" multiplier="-1"/></joint>
</robot>"""

BOX = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
       [1, 5, 7], [1, 7, 3]]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "arm.urdf"
    path.write_text(URDF)
    return path


@pytest.fixture(scope="module")
def robot(path):
    return palpate.Robot(path, standoff=0.015, base=[0, -0.3, 0.75, 0, 0, 0, 1])


@pytest.fixture(scope="module")
def scene():
    """A wall at 1 m before which a post stands, 0.2 m nearer."""
    depth = np.ones((240, 320), np.float32)
    depth[:, 200:230] = 0.8
    return palpate.Scene([palpate.Sensor(palpate.Camera(320, 240, 280, 280, 159.5, 119.5)).update(depth)])


def joints_of(num, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.5, -0.8, 0], [0.8, 0.8, 0.04], (num, 3))


def test_poses_and_torques_are_those_of_pinocchio(path, robot, scene):
    pin = pytest.importorskip("pinocchio", reason="no pinocchio; pip install pin")
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    base = pin.SE3(np.eye(3), robot.base[:3])
    joints = joints_of(100)
    poses = robot.place(joints)
    found = robot.measure(scene, joints)
    assert (np.abs(found.joint_torque).max(0) > 1e-9).all()
    num_torques = 0
    for i, (shoulder, elbow, finger) in enumerate(joints):
        q = np.zeros(model.nq)
        for name, value in {"shoulder": shoulder, "elbow": elbow, "finger": finger, "other": -finger}.items():
            q[model.joints[model.getJointId(name)].idx_q] = value
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        torque = np.zeros(model.nv)
        for k, name in enumerate(robot.link_names):
            X_WL = base * data.oMf[model.getFrameId(name)]
            np.testing.assert_allclose(poses[i, k, :3], X_WL.translation, atol=1e-6)
            q_WL = pin.Quaternion(X_WL.rotation).coeffs()
            np.testing.assert_allclose(np.abs(poses[i, k, 3:] @ q_WL), 1, atol=1e-9)
            J = pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
            lever = X_WL.rotation @ robot.tools[k].center_of_mass
            force, moment = found.wrench[i, k, :3], found.wrench[i, k, 3:]
            torque += J.T @ np.concatenate([force, moment + np.cross(lever, force)])
        v = [model.joints[model.getJointId(name)].idx_v for name in ("shoulder", "elbow", "finger", "other")]
        expected = torque[v[:3]] - [0, 0, torque[v[3]]]
        np.testing.assert_allclose(found.joint_torque[i], expected, atol=1e-6 * max(1e-6, np.abs(expected).max()))
        num_torques += np.abs(expected).max() > 1e-6
    assert num_torques > 10


def test_a_robot_is_its_links_as_tools(robot, scene):
    joints = joints_of(50)
    found = robot.measure(scene, joints, 0.02)
    links = palpate.Contact(robot.tools)
    num = len(robot.link_names)
    batch = links.measure_batch(
        scene, robot.place(joints).reshape(-1, 7), clearance=True,
        tool_of_pose=np.tile(np.arange(num, dtype=np.int32), 50), group_of_pose=np.repeat(np.arange(50, dtype=np.int32), num))
    np.testing.assert_allclose(found.clearance, batch.group_clearance, atol=1e-6)
    np.testing.assert_allclose(found.volume, batch.group_volume, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(found.any, robot.any(scene, joints, 0.02))
    np.testing.assert_array_equal(found.any, found.clearance < 0.02)
    assert found.unseen.shape == (50,) and not found.held.any()


def test_gradient_is_that_of_differences(robot, scene):
    joints = joints_of(40, 3)
    found = robot.measure(scene, joints, contact=False)
    step, num = 1e-5, 0
    for j in range(3):
        more, less = joints.copy(), joints.copy()
        more[:, j] += step
        less[:, j] -= step
        a, b = (robot.measure(scene, q, contact=False) for q in (more, less))
        ahead, behind = ((x - y) / step for x, y in ((a.clearance, found.clearance), (found.clearance, b.clearance)))
        # No derivative exists at corners of the clearance: the nearest sphere or pixel changes there.
        smooth = (found.link >= 0) & (np.abs(ahead - behind) < 1e-4)
        smooth &= (joints[:, 2] > step) & (joints[:, 2] < 0.04 - step)
        np.testing.assert_allclose(found.clearance_by_joint[smooth, j], (ahead + behind)[smooth] / 2, atol=1e-4)
        num += smooth.sum()
    assert num > 30


def test_free_motions_have_no_blocked_sample(robot, scene):
    start, end = joints_of(60, 4), joints_of(60, 5)
    free, until = robot.free_motions(scene, start, end, 0.01)
    assert 5 < free.sum() < 55
    for i in np.flatnonzero(until > 0):
        shares = np.linspace(0, until[i], 400)[:, None]
        assert not robot.any(scene, start[i] + shares * (end[i] - start[i]), 0.01).any()
    np.testing.assert_array_equal(free, until == 1)


def test_a_packed_robot_with_a_tool(robot, scene, tmp_path):
    pen = palpate.pack(np.array([[x, y, z] for x in (-.01, .01) for y in (-.01, .01) for z in (0, .1)]), BOX, 20)
    held = robot.with_tool(pen, "pen", "fore", [0, 0, 0.3, 0, 0, 0, 1])
    held.save(tmp_path / "arm.palprobot")
    again = palpate.Robot(tmp_path / "arm.palprobot", base=robot.base)
    assert again.link_names == ["upper", "fore", "left", "right", "pen"]
    joints = joints_of(20)
    np.testing.assert_array_equal(again.measure(scene, joints).clearance, held.measure(scene, joints).clearance)
    assert (held.measure(scene, joints).clearance <= robot.measure(scene, joints).clearance).all()
    camera = palpate.Camera(320, 240, 280, 280, 159.5, 119.5)
    for dtype, far in ((np.float32, 2.0), (np.float32, 20.0), (np.uint16, 2000)):
        left = held.remove_from(np.full((240, 320), far, dtype), camera, joints[0])
        assert left.dtype == dtype and (left[0] == far).all()
        x, y, z = held.place(joints[:1])[0, 4, :3]
        assert left[round(280 * y / z + 119.5), round(280 * x / z + 159.5)] == 0


def test_bad_input_is_refused_in_a_sentence(path, robot, scene, tmp_path):
    with pytest.raises(ValueError, match=r"\(P, 3\), a number for each"):
        robot.measure(scene, [[0, 0]])
    with pytest.raises(palpate.Error, match="joint 'elbow' of configuration 1 is not a number"):
        robot.any(scene, [[0, 0, 0], [0, np.nan, 0]])
    with pytest.raises(palpate.Error, match="joint 'shoulder' of configuration 0 is at 2.5, beyond its limits -2 to 2"):
        robot.any(scene, [[2.5, 0, 0]], limits="refuse")
    assert robot.measure(scene, [[2.5, 0, 0]]).held.all()
    box = np.array([[x, y, z] for x in (-.1, .1) for y in (-.1, .1) for z in (-.1, .1)])
    body = palpate.Body(palpate.pack(box, BOX, 20), [0, 0, 3, 0, 0, 0, 1])
    with pytest.raises(palpate.Error, match="past CAD bodies are not proved"):
        robot.free_motions(palpate.Scene([body]), [[0, 0, 0]], [[0, 0, 0]])
    with pytest.raises(palpate.Error, match="margin of 0 m or more"):
        robot.free_motions(scene, [[0, 0, 0]], [[0, 0, 0]], -0.001)
    camera = palpate.Camera(320, 240, 280, 280, 159.5, 119.5)
    with pytest.raises(ValueError, match="that of the camera"):
        robot.remove_from(np.ones((120, 160), np.float32), camera, [0, 0, 0])
    bent = palpate.Camera(320, 240, 280, 280, 159.5, 119.5, distortion=[0.1, 0, 0, 0])
    with pytest.raises(ValueError, match="undistort"):
        robot.remove_from(np.ones((240, 320), np.float32), bent, [0, 0, 0])
    with pytest.raises(palpate.Error, match="padding"):
        robot.remove_from(np.ones((240, 320), np.float32), camera, [0, 0, 0], padding=3)
    with pytest.raises(palpate.Error, match="no link 'uper'; the nearest one is 'upper'"):
        palpate.Robot(path, skip=["uper"])
    with pytest.raises(ValueError, match="collision or visual"):
        palpate.Robot(path, geometry="both")
    robot.tools[0].save(tmp_path / "upper.palp")
    with pytest.raises(palpate.Error, match="is a tool, not a robot"):
        palpate.Robot(tmp_path / "upper.palp")
    robot.save(tmp_path / "arm.palprobot")
    with pytest.raises(palpate.Error, match="is not a tool file"):
        palpate.load_tool(tmp_path / "arm.palprobot")
    open_box = tmp_path / "open.obj"
    open_box.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "open.urdf").write_text(URDF.replace('<box size="0.06 0.08 0.3"/>', '<mesh filename="open.obj"/>'))
    with pytest.warns(UserWarning, match="link 'upper' is left out"):
        assert palpate.Robot(tmp_path / "open.urdf").link_names == ["fore", "left", "right"]
