"""An idealised gripper: a weld or a ball joint between a hand and an object, made on demand, broken by a large force.

The hands of the robots cannot grip. Results that use this gripper say so.
"""

import itertools
from collections.abc import Iterable

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.hand_wrench import BREAKING_FORCE
from hugwbc.robot import SIDES, Robot
from hugwbc.sim.scenes.objects import contact_force

REACH = 0.03  # [m], from the hand's surface to that of the object
_LEAST_RADIUS = 0.01  # [m], of a hand without a shape
_UNSEEN_GROUP = 4  # of MuJoCo's groups of geoms
# Layout of a weld's row of `eq_data`: the point in the object's axes, the same in the hand's, and the relative turn.
# The two points of a ball joint are the other way round.
_FIRST, _SECOND, _TURN = slice(0, 3), slice(3, 6), slice(6, 10)
_KINDS = {"grip": mujoco.mjtEq.mjEQ_WELD, "hook": mujoco.mjtEq.mjEQ_CONNECT}


def add_grips(spec: mujoco.MjSpec, names: Iterable[str], robot: Robot) -> None:
    """Add what a `Gripper` needs to a model with robot and objects, whose bodies have these names.

    It is a ball around each hand, up to its tip, from which distances are measured, and inactive joints to each body
    that moves.
    """
    radius = max(robot.hand_tip, _LEAST_RADIUS)
    moving = [body.name for body in spec.bodies if body.name in set(names) and list(body.joints)]
    for side, hand in zip(SIDES, robot.hand_links, strict=True):
        link = spec.body(hand)
        at = spec.site(f"{side}_hand").pos
        ball = link.add_geom(name=f"{side}_hand_ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0])
        ball.pos, ball.mass, ball.group = at, 0.0, _UNSEEN_GROUP
        ball.contype = ball.conaffinity = 0
        for name, (kind, equality) in itertools.product(moving, _KINDS.items()):
            joint = spec.add_equality(name=_joint(side, kind, name), type=equality, active=False)
            joint.objtype, joint.name1, joint.name2 = mujoco.mjtObj.mjOBJ_BODY, hand, name
            joint.solref, joint.solimp = [0.005, 1.0], [0.95, 0.99, 0.001, 0.5, 2.0]


def _joint(side: str, kind: str, name: str) -> str:
    return f"{side}_{kind}/{name}"


class Gripper:
    """The idealised grippers of both hands of one robot.

    Attributes:
        broken: number of grips that a force has broken since the last reset.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, names: Iterable[str], robot: Robot) -> None:
        """Find the joints, and the shapes to measure distances to, in a model that `add_grips` has changed."""
        self._model, self._data = model, data
        self._hands = [model.body(link).id for link in robot.hand_links]
        self._balls = [model.geom(f"{side}_hand_ball").id for side in SIDES]
        self._bodies = {name: model.body(name).id for name in names}
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        self._geoms = {
            name: np.flatnonzero(solid & (model.geom_bodyid == body)).tolist() for name, body in self._bodies.items()
        }
        self._joints = {model.equality(i).name: i for i in range(model.neq)}
        self._grippable = [name for name in self._bodies if _joint(SIDES[0], "grip", name) in self._joints]
        self.reset()

    def reset(self) -> None:
        """Open both hands for a new run."""
        self.broken = 0
        self._held: list[tuple[str, int, float] | None] = [None, None]  # object, joint, breaking force
        self._force = np.zeros((2, 3))

    def held(self, side: str) -> str | None:
        """Return the name of the object in a hand, or None."""
        held = self._held[_hand(side)]
        return None if held is None else held[0]

    def distance(self, name: str, side: str) -> float:
        """Return the distance between the surfaces of a hand and an object [m], at most 1 m."""
        model, data, ball = self._model, self._data, self._balls[_hand(side)]
        if name not in self._bodies:
            raise UnknownNameError("object", name, self._bodies)
        return min((mujoco.mj_geomDistance(model, data, ball, g, 1.0, None) for g in self._geoms[name]), default=1.0)

    def attach(self, name: str, side: str, breaking_force: float = BREAKING_FORCE, *, hook: bool = False) -> bool:
        """Join an object to the "left" or "right" hand as they are now, and return whether the hand holds it.

        Their surfaces must be within `REACH`; the hand lets go of another object.

        Args:
            name: the object.
            side: of the hand.
            breaking_force: force between hand and object at which the joint breaks [N].
            hook: let the hand turn about its origin, as if it hung on a handle; otherwise it is welded on.
        """
        hand = _hand(side)
        if not breaking_force > 0.0:
            raise ConfigError(f"breaking force is {breaking_force} N; give a force above 0 N")
        if name not in self._grippable:
            raise UnknownNameError("object that can be gripped", name, self._grippable)
        if self.distance(name, side) > REACH:
            return False
        self.release(side)
        data, link, body = self._data, self._hands[hand], self._bodies[name]
        point, joint = data.geom_xpos[self._balls[hand]], self._joints[_joint(side, "hook" if hook else "grip", name)]
        row = self._model.eq_data[joint]
        in_object = data.xmat[body].reshape(3, 3).T @ (point - data.xpos[body])
        in_hand = data.xmat[link].reshape(3, 3).T @ (point - data.xpos[link])
        row[_FIRST], row[_SECOND] = (in_hand, in_object) if hook else (in_object, in_hand)
        if not hook:
            row[_TURN] = rotations.multiply(rotations.conjugate(data.xquat[link]), data.xquat[body])
        data.eq_active[joint] = 1
        self._held[hand] = (name, joint, breaking_force)
        return True

    def release(self, side: str) -> None:
        """Let go of what a hand holds, if anything."""
        hand = _hand(side)
        held = self._held[hand]
        if held is not None:
            self._data.eq_active[held[1]] = 0
            self._held[hand] = None
            self._force[hand] = 0.0

    def update(self) -> None:
        """Read the forces of the last physics step, and let go where one is too large."""
        if self._held == [None, None]:
            return
        data = self._data
        equalities = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        for hand, held in enumerate(self._held):
            if held is None:
                continue
            rows = np.flatnonzero(equalities & (data.efc_id == held[1]))
            self._force[hand] = data.efc_force[rows[:3]] if rows.size else 0.0
            if np.linalg.norm(self._force[hand]) > held[2] and np.linalg.norm(self._carried(hand, held[0])) > held[2]:
                self.broken += 1
                self.release(SIDES[hand])

    def _carried(self, hand: int, name: str) -> np.ndarray:
        """Return the force of a held object on a hand in the world, of joint and contact together [N], shape (3,)."""
        return self._force[hand] - contact_force(self._model, self._data, [self._hands[hand]], self._bodies[name])[0]

    @property
    def force(self) -> np.ndarray:
        """Force of the gripped objects on the left and the right hand in the world [N], shape (2, 3)."""
        return self._force.copy()


def _hand(side: str) -> int:
    if side not in SIDES:
        raise UnknownNameError("hand", side, SIDES)
    return SIDES.index(side)
