"""Limits of the legs by joint range (inverse kinematics of a squat with level soles), by torque and by speed.

Of the arguments, h is the height of the pelvis above the nominal one [m], in a leap at take-off, p its pitch [rad],
f the stride frequency [Hz], step_time half a stride [s], and speed that along the heading [m/s]. The parameters give
margins, and the robot what its legs can do.
"""

import bisect
import functools
import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hugwbc.commands import SWING_REACTION, highest_swing
from hugwbc.kinematics import joint_columns, pinocchio_model
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.swing import FALL, PEAK, WAY
from hugwbc.robot import Robot
from hugwbc.state import GRAVITY

_LEAD = 0.03  # [s], time by which the sole turns before the shank forces it to
_STRETCHED = 0.9975  # largest part of the leg's length between hip and ankle: the knee of a straighter leg races
_LEAST_APEX = 1e-3  # [m]
_SECANTS = 4  # number of secant steps to the highest apex


def _interpolate(x: float, xs: tuple[float, ...], ys: tuple[float, ...]) -> float:
    """Interpolate linearly between ascending points, constant beyond them: NumPy's `interp` without its arrays."""
    x = min(max(x, xs[0]), xs[-1])
    k = min(bisect.bisect_right(xs, x), len(xs) - 1)
    if xs[k - 1] == xs[k]:  # at the end of the range, where nothing changes: the first place
        return ys[bisect.bisect_left(xs, x)]
    return ys[k - 1] + (ys[k] - ys[k - 1]) * (x - xs[k - 1]) / (xs[k] - xs[k - 1])


def balance_point(params: ControllerParams, h: float, p: float, *, walking: bool, robot: Robot) -> float:
    """Return the nominal centre of pressure, and of mass when standing, forward of the ankle [m]."""
    foremost = _interpolate(h, robot.squat_heights, robot.squat_reach) + robot.squat_reach_per_pitch * p
    return min(params.balance_ahead, foremost - params.balance_margin[walking])


def cop_reach(params: ControllerParams, robot: Robot) -> float:
    """Return the largest distance of the centre of pressure from the ankle along the sole [m].

    A foot that carries the robot's weight holds it there by the torque of the ankle, and no farther than the nearer of
    heel and toe.
    """
    torque = params.torque_fraction * float(robot.torque_limit[robot.pair("ankle_pitch")[0]])
    return min(torque / (robot.mass * GRAVITY), robot.ankle_x - robot.sole_x[0], robot.sole_x[1] - robot.ankle_x)


def lowest_walking_height(params: ControllerParams, speed: float, step_time: float, p: float, robot: Robot) -> float:
    """Return the lowest h at which the stance ankle still lets the body pass over a level foot [m].

    The centre of mass travels half a step to either side of the pivot, and a squat leaves no room for that.
    """
    # In a backward walk the landing foot is behind the body, where the shank leans most.
    stride = 0.5 * step_time * speed if speed > 0.0 else -(0.5 * step_time + params.backward_room) * speed
    ahead = stride + params.walking_room - robot.squat_reach_per_pitch * p
    return _interpolate(ahead, robot.squat_reach, robot.squat_heights)


def highest_clearance(params: ControllerParams, h: float, f: float, speed: float, robot: Robot) -> float:
    """Return the highest swing apex that the leg reaches in time and whose reaction a narrow foot can bear [m].

    Knee and ankle bound the apex by the height of the pelvis, the hips by their torque (`highest_lift`). The reaction
    of the swing, which grows with l f^2, bounds it by the frequency. A fast walk leaves less of all.
    """
    excess = max(abs(speed) - params.clearance_speed, 0.0)
    reach = highest_swing(robot) - params.clearance_reserve + h - params.clearance_per_speed * excess
    reaction = SWING_REACTION / f**2 * (1.0 - params.swing_reaction_per_speed * excess)
    return max(params.min_clearance, min(reach, reaction, highest_lift(params, h, f, robot, speed=speed)))


def fastest_walk(params: ControllerParams, f: float, robot: Robot) -> float:
    r"""Return the highest speed along the heading for which the hips can swing the legs [m/s].

    A foot travels 2 v T in a step of T = 1 / (2 f), so that its acceleration peaks at :math:`a\, 4 v f` with the factor
    a of `hugwbc.mbc.swing`. For a leg of length L with the inertia I about the hip that takes the torque
    :math:`4 a v f I / L`.
    """
    torque = params.swing_torque * params.torque_fraction * float(robot.torque_limit[robot.pair("hip_pitch")[0]])
    return torque * robot.leg_length / (4.0 * PEAK * f * _leg(robot).swung)


def highest_lift(params: ControllerParams, h: float, f: float, robot: Robot, *, speed: float = 0.0) -> float:
    r"""Return the highest swing apex to which the hips can lift a leg in time [m].

    A knee of angle k puts the ankle :math:`L \cos(k / 2)` below the hip, L being the length of the straight leg, if the
    hip bends by half as much. In half a step, t = 1 / (4 f), the knee bends by

    .. math:: \Delta k = \frac{\ddot k\, t^2}{6}

    if its acceleration starts at :math:`\ddot k` and falls linearly to the opposite at the apex, as that of a cubic
    from rest to rest. The hip carries the reaction of the knee's drive besides its own inertia and is the first joint
    at its limit: its torque per :math:`\ddot k` comes from the mass matrix and hardly depends on k. What it takes to
    swing the leg along the ground (`fastest_walk`) leaves less for the lift.
    """
    leg, straight = _leg(robot), robot.leg_length
    swings = params.swing_torque * abs(speed) / fastest_walk(params, f, robot)
    share = params.torque_fraction * max(min(params.lift_torque, params.hip_torque - swings), 0.0)
    torque = share * float(robot.torque_limit[robot.pair("hip_pitch")[0]])
    stands = _hip_above(h, robot)
    bent = 2.0 * math.acos(stands / straight) + torque / (leg.lifted * 96.0 * f**2)
    return stands - straight * math.cos(0.5 * min(bent, math.pi))


def highest_fall(
    params: ControllerParams, apex: float, h: float, f: float, step: float, robot: Robot, *, speed: float = 0.0
) -> float:
    r"""Return the apex, or the highest one below it from which the knees can bring a foot down in time; 0 for none [m].

    The fall is faster than the rise, and stretches a leg that reaches forward. With the ankle x ahead of the hip and z
    below it, at a distance r, a leg of length L has the knee angle k where :math:`r = L \cos(k / 2)`, and so

    .. math:: \dot k = -\frac{2 \dot r}{\sqrt{L^2 - r^2}}, \qquad \dot r = \frac{x \dot x + z \dot z}{r}

    This speed is greatest about where the foot falls fastest. A step beyond `long_step` counts as one of that length:
    the walk lowers the apex of such a step anyway.

    Args:
        params: the share of the knees' highest speed that a fall may take.
        apex: wanted apex [m].
        h: height of the pelvis above the nominal one [m].
        f: stride frequency [Hz].
        step: distance along the heading from the stance foot to the foothold [m]. A robot that runs ahead of its
            command steps further, and lifts its feet less.
        robot: the robot.
        speed: commanded speed along the heading [m/s].
    """
    length, step = robot.leg_length, min(abs(step), params.long_step)
    stands = _hip_above(h, robot)
    at_rest, travelling = params.fall_speed
    share = at_rest + min(abs(speed) / params.fall_travel, 1.0) * (travelling - at_rest)
    most = share * float(robot.velocity_limit[robot.pair("knee")[0]])
    # The hip passes the stance foot half-way through the step, and the foot goes two steps in the time of one.
    x = step * (2.0 * WAY[0] - 1.0 - 0.25)
    along = step * 2.0 * f * (2.0 * WAY[1] - 1.0)

    def knee_speed(apex: float) -> float:
        z = stands - 0.5 * apex
        r = min(max(math.hypot(x, z), 0.1 * length), _STRETCHED * length)
        return 2.0 * (x * along + z * FALL * apex * 4.0 * f) / (r * math.sqrt(length**2 - r**2))

    slowest, fastest = knee_speed(0.0), knee_speed(apex)
    if slowest >= most:
        return 0.0
    for _ in range(_SECANTS):  # from above: it grows less and less with the apex
        if fastest <= most:
            break
        apex *= (most - slowest) / (fastest - slowest)
        fastest = knee_speed(apex)
    return apex


class _Leg(NamedTuple):
    """The hip torque that a leg's motion takes, in the nominal pose."""

    hip_height: float  # height of the hip above the ankle of a standing foot at h = 0 [m]
    swung: float  # inertia about the hip's pitch axis, with the drive's [kg m^2]
    lifted: float  # torque of the hip per acceleration of the knee, if the hip bends by half as much [kg m^2]


@functools.lru_cache(maxsize=64)  # robots of models that are not ours are new each time
def _leg(robot: Robot) -> _Leg:
    """Return geometry and inertia of a leg from the model of the robot."""
    model = pinocchio_model(robot)
    data, columns = model.createData(), joint_columns(model, robot)
    q = pin.neutral(model)
    q[columns + 1] = robot.nominal
    hip, knee, ankle = (columns[robot.pair(part)[0]] for part in ("hip_pitch", "knee", "ankle_pitch"))
    mass = np.array(pin.crba(model, data, q))
    pin.forwardKinematics(model, data, q)
    joint = model.getJointId(robot.joint_names[robot.pair("hip_pitch")[0]])
    drop = -float(data.oMi[joint].translation[2])  # the neutral base is at the origin
    # The sole stays level: the ankle turns back by half of the knee's angle.
    lifted = 0.5 * mass[hip, hip] - mass[hip, knee] + 0.5 * mass[hip, ankle]
    return _Leg(robot.nominal_height - drop - robot.sole_depth, float(mass[hip, hip]), float(lifted))


def _hip_above(h: float, robot: Robot) -> float:
    """Return the height of the hip above a standing ankle [m]; an absurd h must not stop the loop."""
    return min(max(_leg(robot).hip_height + h, 0.0), robot.leg_length)


def leap_rise(f: float) -> float:
    """Return the rise of the body in the flight of a leap and its sinking in the stance [m].

    A flight of duration T = 1 / (2 f) rises by g T^2 / 8.
    """
    return GRAVITY / (32.0 * f**2)


def lowest_leaping_height(params: ControllerParams, f: float, legs: int) -> float:
    """Return the lowest h at take-off that leaves room to sink in the stance of a leap of one or two legs [m]."""
    return (params.hop_depth if legs == 1 else params.leap_depth) + leap_rise(f)


def highest_leaping_height(params: ControllerParams, robot: Robot) -> float:
    """Return the highest h at take-off from which bent legs still push [m]: straight ones run out before the flight."""
    return robot.leg_length - params.leap_reserve - _leg(robot).hip_height


def highest_leap_clearance(params: ControllerParams, h: float, f: float, robot: Robot) -> float:
    """Return the highest apex of the feet in a leap [m].

    The feet rise with the body and cannot be drawn in further than in a walk.
    """
    rise = leap_rise(f)
    reach = highest_swing(robot) - params.clearance_reserve + h
    return max(params.min_clearance, min(reach + rise, rise + params.leap_tuck / f**2))


def leap_lean(params: ControllerParams, h: float, f: float, apex: float, speed: float, robot: Robot) -> float:
    r"""Return how far a foot goes backwards per distance upwards in a jump, so that the pelvis does not sway.

    A leg that is pulled up straight moves its knee forwards, and half of an H1's mass is in its legs: the pelvis would
    go back. A foot that goes back as far as the knee goes forwards keeps the leg's mass below the hip. A leg of length
    L, s between hip and ankle, has its knee :math:`\frac{1}{2} \sqrt{L^2 - s^2}` ahead of the line between them. The
    faster the jump, the less torque the hips, which swing the legs forwards (`fastest_walk`), can spare for it.
    """
    length = robot.leg_length
    stands = _hip_above(h, robot)
    pulled = max(stands + leap_rise(f) - apex, 0.0)  # the body rises, too
    forwards = 0.5 * (math.sqrt(length**2 - min(pulled, length) ** 2) - math.sqrt(length**2 - stands**2))
    fastest = params.jump_speed * fastest_walk(params, f, robot)
    spare = 1.0 - min(max(speed / fastest, 0.0), 1.0)
    return spare * forwards / max(apex, _LEAST_APEX)


def toe_down(shank_pitch: float, shank_rate: float, slope: float, robot: Robot) -> float:
    """Return the pitch of a lifted sole [rad]: that of the ground, until the ankle's range forces the toe down.

    The lean of the shank [rad] and its rate [rad/s] are positive forwards, the slope is with the toe down [rad].
    """
    return max(shank_pitch + _LEAD * shank_rate - robot.level_shank, slope)
