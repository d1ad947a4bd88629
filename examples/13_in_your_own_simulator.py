"""Drive the robot of a MuJoCo model that is not ours: other names, other drives, your own loop of physics steps.

The model is put together here so that the example needs no download: our H1 under the names of a laboratory, with
torque motors, before a post with a lamp. With a model of your own, the lines from `MujocoRobot` on are all that you
need.

    python examples/13_in_your_own_simulator.py --controller qp
"""

import mujoco
import numpy as np

from hugwbc import load_robot
from hugwbc.behaviours import BehaviourSource, Course, View, reach, walk_to
from hugwbc.runtime import MujocoRobot, UpperBodySource
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.viz.show import run_script

SCENE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <light pos="0 0 4"/>
    <geom type="plane" size="9 9 1"/>
    <body name="lamp" pos="1.2 0.2 1.2"><geom type="sphere" size="0.03" contype="0" conaffinity="0"/></body>
  </worldbody>
</mujoco>
"""


def laboratory() -> mujoco.MjModel:
    """Return the scene with a robot whose joints are lab/left_knee and so on, each with a torque motor."""
    scene, robot = mujoco.MjSpec.from_string(SCENE), mujoco.MjSpec.from_file(str(load_robot().xml_path))
    for part in (*robot.keys, robot.geom("floor")):
        robot.delete(part)
    for joint in robot.joints[1:]:
        joint.name = joint.name.removesuffix("_joint")
    for motor in robot.actuators:
        motor.name = motor.target = motor.target.removesuffix("_joint")
        motor.set_to_motor()
    robot.option = scene.option
    scene.attach(robot, prefix="lab/", frame=scene.worldbody.add_frame())
    return scene.compile()


def light(view: View) -> Course:
    """Walk to the lamp and touch it with the left hand."""
    view = yield from walk_to(view, before="lamp", distance=0.4, aside=-0.2)
    return (yield from reach(view, left=(0.0, 0.0, 0.0), frame="lamp"))


def main(controller: str = "learned", duration: float = 20.0) -> None:
    """Walk to the lamp and touch it.

    Args:
        controller: qp or learned.
        duration: longest duration [s].
    """
    model = laboratory()
    data = mujoco.MjData(model)
    robot = MujocoRobot(model, data)
    told = robot.robot
    print(f"found {told.name} under '{robot.prefix}': {told.mass:.1f} kg, beside {', '.join(robot.names)}")

    chosen = ControllerSpec(controller).build(told)
    behaviour = BehaviourSource(light)
    control = robot.control_period(chosen, behaviour, UpperBodySource(robot=told))
    robot.stand()
    control.start(robot.state(), data.time)
    while data.time < duration and not behaviour.done:
        control.observe(robot.state(), data.time)
        command = control.decide(data.time)
        for _ in range(round(chosen.period / model.opt.timestep)):
            robot.apply(command)
            mujoco.mj_step(model, data)

    x, y, z = data.body("lamp").xpos - data.site("lab/left_hand").xpos
    print(f"The left hand is {100 * np.hypot(np.hypot(x, y), z):.1f} cm from the lamp after {data.time:.1f} s.")
    print(f"The behaviour is {behaviour.ending}.")
    print(f"{robot.clipped.total()} times a motor could not give the torque that was asked of it.")


if __name__ == "__main__":
    run_script(main)
