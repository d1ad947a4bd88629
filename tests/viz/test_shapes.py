"""MuJoCo's shapes as meshcat's."""

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.sim import Simulation
from hugwbc.viz.shapes import capsule_rings, homogeneous, object_shapes, ring_mesh, visual_shapes


def test_a_capsule_becomes_a_cylinder_and_two_spheres_at_its_ends() -> None:
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><asset><material name="m" rgba="1 0.5 0 1"/></asset><worldbody>
          <body name="b"><geom type="capsule" size="0.1 0.3" pos="1 2 3" euler="90 0 0" group="2" material="m"/>
          <geom type="box" size="0.1 0.2 0.3" group="3"/></body></worldbody></mujoco>""")
    cylinder, low, high = visual_shapes(model)
    assert {s.link for s in (cylinder, low, high)} == {"b"}
    assert (cylinder.primitive.height, cylinder.primitive.radiusTop) == (0.6, 0.1)
    assert low.primitive.radius == high.primitive.radius == 0.1
    # Turned by 90 degrees about x, the capsule's z axis points to -y.
    np.testing.assert_allclose(low.placement[:3, 3], [1, 2.3, 3], atol=1e-9)
    np.testing.assert_allclose(high.placement[:3, 3], [1, 1.7, 3], atol=1e-9)
    # meshcat's cylinder axis, y, comes to lie along the capsule's.
    np.testing.assert_allclose(cylinder.placement[:3, 1], [0, -1, 0], atol=1e-9)
    np.testing.assert_allclose(cylinder.colour, (1, 0.5, 0), atol=1e-6)


def test_homogeneous_agrees_with_the_rotation() -> None:
    quaternion = rotations.from_yaw_pitch_roll(0.3, -0.2, 1.0)
    placement = homogeneous(np.array([1.0, 2.0, 3.0]), quaternion)
    np.testing.assert_allclose(placement[:3, :3], rotations.to_matrix(quaternion), atol=1e-12)
    np.testing.assert_array_equal(placement[:, 3], [1, 2, 3, 1])


def test_the_shapes_of_a_scene_are_all_that_is_drawn_of_it() -> None:
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><asset>
            <material name="m" rgba="1 0.5 0 1"/>
            <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
          </asset><worldbody>
          <geom type="plane" size="1 1 1"/>
          <geom type="box" size="0.1 0.2 0.3" rgba="0 0 1 1"/>
          <body name="b"><geom type="mesh" mesh="wedge" material="m"/><geom type="box" size="1 1 1" group="3"/></body>
        </worldbody></mujoco>""")
    box, wedge = object_shapes(model)
    assert (box.link, box.colour, wedge.link, wedge.colour) == ("world", (0.0, 0.0, 1.0), "b", (1.0, 0.5, 0.0))
    corners = wedge.placement[:3, :3] @ np.asarray(wedge.primitive.vertices).T + wedge.placement[:3, 3:]
    found = sorted((np.round(corners.T, 5) + 0.0).tolist())  # + 0.0 makes -0.0 a 0.0
    np.testing.assert_allclose(found, [[0, 0, 0], [0, 0, 0.1], [0, 0.1, 0], [0.1, 0, 0]], atol=1e-6)


def test_the_rings_of_the_head_are_smooth_closed_tubes() -> None:
    model = Simulation().model
    rings = capsule_rings(model)
    assert [len(ring) for ring in rings] == [16, 16]
    assert [model.mat(model.geom_matid[ring[0]]).name for ring in rings] == ["light", "lamp"]
    vertices, faces = ring_mesh(model, rings[0])
    radius = model.geom_size[rings[0][0], 0]
    for geom in rings[0]:  # the tube passes where the capsules are
        middle = model.geom_pos[geom]
        nearest = np.min(np.linalg.norm(vertices - middle, axis=1))
        assert 0.9 * radius < nearest < 1.3 * radius
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2), "no holes"
    torso = [shape for shape in visual_shapes(model) if shape.link == "torso_link"]
    assert len(torso) < 40, "a ring is one shape"
