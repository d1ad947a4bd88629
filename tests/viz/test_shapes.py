"""MuJoCo's shapes as meshcat's."""

import mujoco
import numpy as np

from hugwbc.viz.shapes import shapes_of


def test_a_capsule_becomes_a_cylinder_and_two_spheres_at_its_ends() -> None:
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><asset><material name="m" rgba="1 0.5 0 1"/></asset><worldbody>
          <body name="b"><geom type="capsule" size="0.1 0.3" pos="1 2 3" euler="90 0 0" group="2" material="m"/>
          <geom type="box" size="0.1 0.2 0.3" group="3"/></body></worldbody></mujoco>""")
    cylinder, low, high = shapes_of(model)
    assert {s.body for s in (cylinder, low, high)} == {"b"}
    assert (cylinder.primitive.height, cylinder.primitive.radiusTop) == (0.6, 0.1)
    assert low.primitive.radius == high.primitive.radius == 0.1
    # Turned by 90 degrees about x, the capsule's z axis points to -y.
    np.testing.assert_allclose(low.placement[:3, 3], [1, 2.3, 3], atol=1e-9)
    np.testing.assert_allclose(high.placement[:3, 3], [1, 1.7, 3], atol=1e-9)
    # meshcat's cylinder axis, y, comes to lie along the capsule's.
    np.testing.assert_allclose(cylinder.placement[:3, 1], [0, -1, 0], atol=1e-9)
    assert cylinder.colour == "#ff8000"


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
    box, wedge = shapes_of(model)
    assert (box.body, box.colour, wedge.body, wedge.colour) == ("world", "#0000ff", "b", "#ff8000")
    corners = wedge.placement[:3, :3] @ np.asarray(wedge.primitive.vertices).T + wedge.placement[:3, 3:]
    found = sorted((np.round(corners.T, 5) + 0.0).tolist())  # + 0.0 makes -0.0 a 0.0
    np.testing.assert_allclose(found, [[0, 0, 0], [0, 0, 0.1], [0, 0.1, 0], [0.1, 0, 0]], atol=1e-6)
