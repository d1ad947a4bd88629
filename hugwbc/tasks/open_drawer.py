"""Hook the handle of a drawer with a hand, and pull the drawer open by 25 cm."""

import numpy as np

from hugwbc.scripts.behaviours import Course, Grip, Pull, View, seen
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.judges import at_end, happened
from hugwbc.tasks.moves import NO_HAND, Moves, crouch, hands_in
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone

OPENED = 0.25  # [m]

MILESTONES = (
    happened(lambda record: "drawer" in record.gripped, "no hand got hold of the handle"),
    Milestone("the drawer was not pulled open by 25 cm", lambda record: record.travel["drawer"].max() / OPENED),
    Milestone("the drawer did not stay open", lambda record: at_end(record.travel["drawer"]) / (OPENED - 0.005)),
)


_REACH, _ASIDE = 0.42, 0.18  # [m], of the pelvis from the handle, which is in front of the right shoulder
_BAR = 0.06  # [m], from the front of the cabinet to the handle
# [m], from the hand frame to the handle when it is hooked: a hand that touches it would press against its own hook.
_TIP = 0.068
_FARTHER = 0.02  # [m], than the drawer has to open
_SPEED = 0.2  # [m/s]
# [N]; a policy that starts to walk out of a crouch drops for a moment, and hangs on the hook with 150 N.
_STRONG = 300.0
_YIELDING = 400.0  # [N/m], of a hand that pulls: the hook must not break by the sway of a step


class OpenDrawer(Moves):
    """Walk to the drawer, hook the handle with the right hand, and walk back until it is seen to be open."""

    timeout = 60.0

    def __init__(self, shapes: Shapes) -> None:
        """Take the depth of the drawer."""
        self._handle = settled(shapes["drawer"]["size"][0]) / 2 + _BAR  # type: ignore[index]

    def course(self, view: View) -> Course:  # noqa: D102
        self.doing = "walk to the drawer"
        view = yield from self.walk(view, WalkTo(before="drawer", distance=self._handle + _REACH, aside=_ASIDE))
        self.doing = "reach for the handle"
        closed = seen(view, "drawer")
        ahead = closed.direction(np.array([1.0, 0.0, 0.0]))
        bar = closed.position - self._handle * ahead
        posture = crouch(float(bar[2]) + 0.1)
        for gap in (0.10, 0.0):
            points = np.stack([NO_HAND, bar - (_TIP + gap) * ahead])
            view = yield from self.glide(
                view, points, frame="world", directions=(None, ahead), posture=posture, speed=0.15, settle=0.5
            )
        self.doing = "hook the handle"
        view = yield from self.grip(view, Grip("right", "drawer", hook=True, breaking_force=_STRONG))
        self.doing = "pull the drawer"
        hands = np.stack([NO_HAND, hands_in(view, "heading")[1]])
        view = yield from self.glide(view, hands, stiffness=_YIELDING)
        view = yield from self.walk(view, Pull("drawer", OPENED + _FARTHER, speed=_SPEED))
        self.doing = "let go of the handle"
        view = yield from self.grip(view, Grip("right", None))
        return (yield from self.wait(view, 0.5))


TASK = Task(
    name="open_drawer",
    about="Hook the handle of a drawer, and pull it open by 25 cm against 10 to 20 N.",
    scene=scene_of("open_drawer"),
    behaviour=OpenDrawer,
    limit=70.0,
    milestones=MILESTONES,
    idealised=("attach",),
)
