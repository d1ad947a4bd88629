"""Things with one joint: doors with a closer, drawers, and spring buttons."""

import math
from typing import Annotated, Any, Literal

import mujoco

from hugwbc.settings import settings
from hugwbc.sim.scenes.thing import LEAST_FRICTION, Placement, Thing, darker
from hugwbc.sim.scenes.varied import Colour, Length, Mass, Number, between, settled

_BOX = mujoco.mjtGeom.mjGEOM_BOX
_Leaf = Annotated[Number, between(0.2, 10.0)]  # [m]
_Side = Annotated[Number, between(0.05, 10.0)]  # [m], of a drawer
# A closer's torque is that of a spring which is wound by this angle while the door is shut: it grows by a fifth over a
# quarter turn.
_WOUND = 7.5  # [rad]
_WIDEST = 1.75  # [rad], largest angle of a door
_CLOSING_SPEED = 0.5  # [rad/s], at which the closer's damping balances its torque
# Dry friction is a soft constraint in MuJoCo: as firm as that of the robot's joints (`sim.actuators`), it holds still.
_STICK = [0.99, 0.99, 0.001, 0.5, 2.0]
_FIRM = [0.004, 1.0]  # time constant [s] and damping ratio


@settings(kw_only=True)
class Jointed(Thing):
    """A thing with a part that moves by one joint, and a part that stands still.

    The moving part is the body NAME. `ObjectState.travel` says how far it is from where it rests.
    """

    mass: Mass = 1.0  # of the moving part [kg]

    def _joint(self, body: Any, kind: mujoco.mjtJoint, axis: list[float], end: float, **fields: Any) -> None:  # noqa: ANN401
        """Add the joint, with firm stops at rest and at the end [rad or m]."""
        joint = body.add_joint(name=self.name, type=kind, axis=axis, limited=True, range=[0.0, end], **fields)
        joint.solref_limit, joint.solimp_limit = _FIRM, [0.95, 0.99, 0.001, 0.5, 2.0]
        joint.solref_friction, joint.solimp_friction = _FIRM, _STICK

    def _join(self, spec: mujoco.MjSpec) -> None:
        """Let the two parts pass through each other: the joint keeps them in their places."""
        moving, still = self.body_names()
        spec.add_exclude(name=still, bodyname1=moving, bodyname2=still)


@settings(kw_only=True)
class Door(Jointed):
    """A hinged door in a frame, with a closer; it opens towards +x, for a robot that pushes from -x.

    The closer turns it shut with a nearly constant torque. It is damped while it closes, and hardly while it is opened.
    Its position is the middle of the doorway. The pose of the leaf is that of its hinge, at the ground.

    Attributes:
        hinge: "left" or "right", as seen from -x.
        size: thickness along x, width along y, and height of the leaf [m].
        closer: torque of the closer [N*m]; 0 for none.
    """

    hinge: Literal["left", "right"]
    size: tuple[Length, _Leaf, _Leaf] = (0.04, 0.9, 2.05)
    mass: Mass = 20.0
    closer: Annotated[Number, between(0.0, 100.0)] = 10.0
    friction: Annotated[Number, between(LEAST_FRICTION, 5.0)] = 0.5
    colour: Colour = "#8f6f52"

    def body_names(self) -> tuple[str, ...]:  # noqa: D102
        return self.name, f"{self.name}/frame"

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        thick, width, height = (settled(value) for value in self.size)
        side = 1.0 if self.hinge == "left" else -1.0
        gap, post = 0.01, 0.04  # [m], around the leaf; half the width of a post
        closer, frame = settled(self.closer), self._body(spec, place, 0.0, f"{self.name}/frame")
        colour = darker(str(self.colour))
        for end in (-1, 1):
            at = [0.0, end * (width / 2 + gap + post), height / 2]
            self._geom(frame, _BOX, [thick, post, height / 2], at, rgb=colour)
        lintel = [0.0, 0.0, height + gap + post]
        self._geom(frame, _BOX, [thick, width / 2 + gap + 2 * post, post], lintel, rgb=colour)
        leaf = self._body(spec, place.shifted(0.0, side * width / 2, 0.0, 0.0), 0.0)
        at = [0.0, -side * width / 2, gap + (height - gap) / 2]
        self._geom(leaf, _BOX, [thick / 2, width / 2, (height - gap) / 2], at, mass=settled(self.mass))
        plate = [0.0, -side * (width - 0.12), 1.05]  # where to push
        self._geom(leaf, _BOX, [thick / 2 + 0.002, 0.05, 0.15], plate, rgb="#c9ccd1", contype=0, conaffinity=0)
        spring = {"stiffness": closer / _WOUND, "springref": -_WOUND}
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        self._joint(leaf, hinge, [0.0, 0.0, side], _WIDEST, damping=0.3, frictionloss=0.2, **spring)
        self._join(spec)
        if closer > 0.0:
            _add_damper(spec, self.name, closer / _CLOSING_SPEED)


def _add_damper(spec: mujoco.MjSpec, joint: str, damping: float) -> None:
    """Add a damper [N*m*s/rad] that acts while the joint moves back to rest: a force that cannot be negative."""
    damper = spec.add_actuator(name=f"{joint}/damper", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    damper.gaintype, damper.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    damper.gainprm = [0.0] * 10
    damper.biasprm = [0.0, 0.0, -damping, *[0.0] * 7]
    damper.forcelimited, damper.forcerange = True, [0.0, 10.0 * damping]


@settings(kw_only=True)
class Drawer(Jointed):
    """A drawer in a cabinet, with a bar for a handle; it opens towards -x. Its pose is that of the drawer's centre.

    Attributes:
        size: depth along x, width along y, and height of the drawer [m].
        height: of the drawer's centre above the ground [m].
        resistance: dry friction of the slides [N].
        travel: how far it opens [m].
        handle: distance of the bar from the cabinet's front [m].
    """

    size: tuple[_Side, _Side, _Side] = (0.4, 0.45, 0.16)
    height: Annotated[Number, between(0.1, 2.0)] = 0.85
    mass: Mass = 3.0
    resistance: Annotated[Number, between(0.0, 200.0)] = 15.0
    travel: Annotated[Number, between(0.01, 2.0)] = 0.3
    handle: Annotated[Number, between(0.03, 0.5)] = 0.06

    def body_names(self) -> tuple[str, ...]:  # noqa: D102
        return self.name, f"{self.name}/cabinet"

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.height) + settled(self.size[2]) / 2 + 0.03)

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        depth, width, height = (settled(value) / 2 for value in self.size)
        middle, gap, wall = settled(self.height), 0.005, 0.0125
        cabinet = self._body(spec, place, 0.0, f"{self.name}/cabinet")
        colour = darker(str(self.colour))
        top, low = middle + height + gap, max(middle - height - gap, 0.03)
        long = [0.0, 0.0, top + wall]
        self._geom(cabinet, _BOX, [depth, width + gap + 2 * wall, wall], long, rgb=colour)
        self._geom(cabinet, _BOX, [depth, width + gap + 2 * wall, low / 2], [0.0, 0.0, low / 2], rgb=colour)
        for side in (-1, 1):
            at = [0.0, side * (width + gap + wall), (low + top) / 2]
            self._geom(cabinet, _BOX, [depth, wall, (top - low) / 2], at, rgb=colour)
        body, mass = self._body(spec, place, middle), settled(self.mass)
        # Only front and handle collide: the slides carry the drawer, and its walls stay inside the cabinet's.
        self._geom(body, _BOX, [0.009, width, height], [-depth - 0.009, 0.0, 0.0], mass=0.4 * mass)
        inside = {"mass": 0.5 * mass, "contype": 0, "conaffinity": 0}
        self._geom(body, _BOX, [depth - 0.02, width - 0.02, height - 0.02], **inside)
        metal, bar = "#5b6068", -depth - settled(self.handle)
        for side in (-1, 1):
            at = [(bar - depth - 0.018) / 2, side * 0.07, 0.0]
            self._geom(body, _BOX, [(-depth - 0.018 - bar) / 2, 0.006, 0.006], at, mass=0.02 * mass, rgb=metal)
        self._geom(body, _BOX, [0.008, 0.085, 0.008], [bar, 0.0, 0.0], mass=0.06 * mass, rgb=metal)
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        friction = settled(self.resistance)
        self._joint(body, slide, [-1.0, 0.0, 0.0], settled(self.travel), damping=2.0, frictionloss=friction)
        self._join(spec)


@settings(kw_only=True)
class Button(Jointed):
    """A spring button on a panel that faces -x; its pose is that of the button's centre.

    Attributes:
        height: of the button above the ground [m].
        radius: of the button [m].
        force: needed to press it all the way [N]; the first movement takes a fifth of it.
        travel: how far it can be pressed [m].
    """

    height: Annotated[Number, between(0.25, 2.0)] = 1.1
    radius: Annotated[Number, between(0.001, 0.2)] = 0.05
    mass: Mass = 0.05
    force: Annotated[Number, between(0.1, 200.0)] = 15.0
    travel: Annotated[Number, between(0.002, 0.1)] = 0.02
    colour: Colour = "#c23b3b"

    def body_names(self) -> tuple[str, ...]:  # noqa: D102
        return self.name, f"{self.name}/panel"

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        height, radius, travel = settled(self.height), settled(self.radius), settled(self.travel)
        force, mass = settled(self.force), settled(self.mass)
        panel = self._body(spec, place, 0.0, f"{self.name}/panel")
        half = travel / 2 + 0.01
        self._geom(panel, _BOX, [0.02, 0.2, 0.2], [0.02 + half, 0.0, height], rgb="#4a5058")
        self._geom(panel, _BOX, [0.02, 0.04, (height - 0.2) / 2], [0.02 + half, 0.0, (height - 0.2) / 2], rgb="#4a5058")
        body = self._body(spec, place, height)
        turn = [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]  # a cylinder lies along z
        self._geom(body, mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, half], mass=mass, quat=turn, condim=3)
        stiffness = 0.8 * force / travel
        spring = {"stiffness": stiffness, "springref": -0.2 * force / stiffness}
        damping = 1.4 * math.sqrt(mass * stiffness)  # 0.7 of the critical: it comes back without ringing
        self._joint(body, mujoco.mjtJoint.mjJNT_SLIDE, [1.0, 0.0, 0.0], travel, damping=damping, **spring)
        self._join(spec)
