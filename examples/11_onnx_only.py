"""Run an H1's policy that `hugwbc export` wrote with onnxruntime and MuJoCo alone: a pattern for other simulators.

Nothing of hugwbc is imported. The file holds the network and, as JSON in its metadata, a contract: observations,
scales, gains, the pose at action 0 (docs/evaluation.md). This script walks ahead; drives are ideal.

    hugwbc export --out h1.onnx
    python examples/11_onnx_only.py --policy h1.onnx --model models/h1/h1.xml --v-x 0.5
"""

import argparse
import json
import math
import sys

import mujoco
import numpy as np
import onnxruntime

LOWEST, LEG = 0.6, 0.8  # [m], lowest pelvis of a robot that is up; from the hip to the ankle of a straight leg
HIGHEST = 0.35  # [m], swing of the highest command: the legs take what curves ask for beyond it, the network does not
SHANK, BENT, STRAIGHT = 0.856, 0.5224, 0.98  # [rad], lean of a shank where its ankle ends; shares of `LEG` of a knee
LEFT_FOOT = 0.5  # of a walking cycle, by which the left foot is ahead of the right one
NEUTRAL = {"v_x": 0.0, "v_y": 0.0, "omega": 0.0, "f": 2.0, "l": 0.15, "h": 0.0, "p": 0.0, "w": 0.0}  # command


def scales(contract: dict, group: str) -> dict:
    """Return the scale of each term of one of the network's inputs."""
    return {term["term"]: np.array(term["scale"]) for term in contract[group]}


def command_row(contract: dict, command: dict, phase: float) -> np.ndarray:
    """Return what the network reads of a walking command: scaled values, the gait, clocks of both feet, indicator."""
    read = command | {"l": min(command["l"], HIGHEST)}
    scaled = scales(contract, "command")["command"] * [read[name] for name in NEUTRAL]
    angle = 2.0 * math.pi * (phase + np.array([LEFT_FOOT, 0.0]))
    walking = [0.0, 1.0, 0.0, 0.0, 0.0]  # of standing, walking, jumping, hopping left, hopping right
    return np.array([[*scaled, *walking, *np.sin(angle), *np.cos(angle), 0.0]], dtype=np.float32)


def asked(contract: dict, command: dict) -> dict:
    """Return what to ask the network for, by the contract's curves, so that it executes a walking command."""
    curves = contract["feed_forward"].get("walking", {})
    return command | {name: float(np.interp(command[name], *np.transpose(curve))) for name, curve in curves.items()}


def feed_forward(contract: dict, command: dict, phase: float) -> np.ndarray:
    """Return what is added to the joint targets: legs that squat, lean, and lift their feet by the clock."""
    names, nominal, result = contract["joints"], contract["default_pose"], np.zeros(len(contract["joints"]))
    squat, swing = contract["squat_gain"], contract["swing_gain"]
    for side, offset in (("left", LEFT_FOOT), ("right", 0.0)):
        later = phase + command["f"] * contract["period"] + offset
        u = 1.0 - abs(later % 1.0 - 0.75) / 0.25  # 0 at lift-off and touch-down, 1 at the apex
        height = command["l"] * u**3 * (10.0 - 15.0 * u + 6.0 * u**2) if u > 0.0 else 0.0
        hip, knee, ankle = (names.index(f"{side}_{part}_joint") for part in ("hip_pitch", "knee", "ankle"))
        half = nominal[knee] / 2.0
        share = min(max(math.cos(half) + (squat * command["h"] - swing * height) / LEG, BENT), STRAIGHT)
        shank = min(math.acos(share), SHANK)
        thigh = math.acos(2.0 * share - math.cos(shank))
        result[[hip, knee, ankle]] = half - thigh - squat * command["p"], thigh + shank - 2.0 * half, half - shank
    return result


def frame(contract: dict, data: mujoco.MjData, action: np.ndarray) -> np.ndarray:
    """Return what the network reads of the robot now: turning, gravity, joints, last action."""
    down = data.body("pelvis").xmat.reshape(3, 3).T @ [0.0, 0.0, -1.0]
    parts = (data.qvel[3:6], down, data.qpos[7:26] - contract["default_pose"], data.qvel[6:25], action)
    scaled = [s * part for s, part in zip(scales(contract, "observation").values(), parts, strict=True)]
    return np.concatenate(scaled).astype(np.float32)


def walk(policy: str, model: mujoco.MjModel, v_x: float, duration: float) -> mujoco.MjData:
    """Walk ahead at v_x [m/s] for a time [s], and return the robot at the end, or where it fell."""
    session = onnxruntime.InferenceSession(policy, providers=["CPUExecutionProvider"])
    contract = json.loads(session.get_modelmeta().custom_metadata_map["contract"])
    if contract["robot"] != "h1" or [model.actuator(i).name for i in range(model.nu)] != contract["joints"]:
        raise ValueError("policy or model are not an H1's, with actuators in the order of the contract's joints")
    # MuJoCo's position actuators are the PD law tau = kp (target - q) - kd dq.
    model.actuator_gainprm[:, 0] = contract["kp"]
    model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -np.array(contract["kp"]), -np.array(contract["kd"])
    data, command = mujoco.MjData(model), asked(contract, NEUTRAL | {"v_x": v_x})
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    action, phase = np.zeros(model.nu), 0.0
    history = np.tile(frame(contract, data, action), (contract["history"]["frames"], 1))
    while data.time < duration - 1e-9 and data.qpos[2] > LOWEST:
        history = np.vstack((history[1:], frame(contract, data, action)))
        phase = (phase + command["f"] * contract["period"]) % 1.0
        inputs = {"history": history.reshape(1, -1), "command": command_row(contract, command, phase)}
        action = np.asarray(session.run(["action"], inputs)[0])[0]
        data.ctrl[:] = contract["default_pose"] + np.array(contract["action_scale"]) * action
        data.ctrl[:] += feed_forward(contract, command, phase)
        mujoco.mj_step(model, data, round(contract["period"] / model.opt.timestep))
    return data


def main() -> None:
    """Read the options, walk, and print how far."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", default="h1.onnx", help="file of `hugwbc export`")
    parser.add_argument("--model", default="models/h1/h1.xml", help="MJCF of the robot")
    parser.add_argument("--v-x", type=float, default=0.5, help="forward velocity [m/s]")
    parser.add_argument("--duration", type=float, default=5.0, help="how long to walk [s]")
    options = parser.parse_args()
    try:
        data = walk(options.policy, mujoco.MjModel.from_xml_path(options.model), options.v_x, options.duration)
    except Exception as error:  # onnxruntime's errors share no class but Exception
        print(f"11_onnx_only.py: {error}", file=sys.stderr)
        sys.exit(2)
    x, y, z = data.qpos[:3]
    fate = f"{'stayed up' if z > LOWEST else 'fell'}; the pelvis is at {z:.2f} m"
    print(f"walked {math.hypot(x, y):.2f} m in {data.time:.1f} s and {fate}")


if __name__ == "__main__":
    main()
