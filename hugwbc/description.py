"""Links, joints, frames and soles of a robot from the URDF or MJCF that its maker publishes."""

import itertools
import math
import pathlib
import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.errors import ModelError

_SOLE_DEPTH = 0.01  # [m], height of the foot's lowest part, which counts as its sole
_TILTED = 5.0  # [degrees], tilt of a box in the foot above which its sole is not level with the link's axes
CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))  # of a cube
_SHAPES = mujoco.mjtGeom
_LOOPS = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
_SIMPLE = (_SHAPES.mjGEOM_BOX, _SHAPES.mjGEOM_SPHERE, _SHAPES.mjGEOM_CAPSULE, _SHAPES.mjGEOM_CYLINDER)


def read_description(file: pathlib.Path) -> dict[str, Any]:
    """Return the rows `joints` and `links` of a published URDF or MJCF, and its `frames`: sites and fixed links.

    `coupled` has the names of joints that follow another one, and of those that they follow. Fixed links count as parts
    of those that carry them. Meshes and textures are not read. A description of another form raises a `ModelError`.
    """
    spec, root = _spec(file), ET.parse(file).getroot()  # noqa: S314  the user's
    if root.tag == "mujoco" and spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        raise ModelError(
            f'{file} takes inertias from shapes (inertiafromgeom="true"); leave it out, and give <inertial>'
        )
    if root.tag == "mujoco" and (lacking := [body.name for body in spec.bodies[1:] if _weighed_by_shapes(body)]):
        raise ModelError(f"{file} gives {', '.join(lacking)} no <inertial>, only shapes; give each body its inertia")
    if any(equality.type in _LOOPS for equality in spec.equalities):
        raise ModelError(f"{file} closes loops of links (<connect>, <weld>); give a description that is a tree")
    coupled = {name for equality in spec.equalities for name in (equality.name1, equality.name2)}
    coupled |= {row.get("name", "") for row in root.iter("joint") if row.find("mimic") is not None}
    coupled |= {row.get("joint", "") for row in root.iter("mimic")}
    _keep(spec, [])
    taken = {site.name for site in spec.sites}
    for body in spec.bodies[1:]:
        if len(body.joints) > 1:
            raise ModelError(f"{file} has {len(body.joints)} joints on {body.name}; give each a link of its own")
        if not body.joints and body.name not in taken:
            body.add_site(name=body.name)
    spec.compiler.fusestatic = True
    model = _compile(spec, file)
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & ~model.jnt_pos.any(axis=1)
    if others := [model.joint(j).name for j in range(1, model.njnt) if not hinges[j]]:
        raise ModelError(f"only hinges at their links' origins are valid, and {file} has {', '.join(others)}")
    if turned := [model.joint(j).name for j in range(1, model.njnt) if model.qpos0[model.jnt_qposadr[j]]]:
        raise ModelError(
            f"{file} has a ref of {', '.join(turned)}; leave it out, and take it from both ends of `range`"
        )
    if sprung := [model.joint(j).name for j in range(1, model.njnt) if model.jnt_stiffness[j]]:
        raise ModelError(
            f"{file} has a spring (stiffness) in {', '.join(sprung)}; leave it out: here drives alone move"
        )
    if "" in (*(model.body(i).name for i in range(model.nbody)), *(model.joint(j).name for j in range(1, model.njnt))):
        raise ModelError(f"{file} has a link or a joint without a name; give it one")
    rows = root.findall("joint")  # transmissions have joints of their own
    speed = {joint.get("name"): joint.find("limit") for joint in rows}
    joints, links = [], []
    for body in range(1, model.nbody):
        axes = rotations.to_matrix(model.body_iquat[body])
        tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
        keys = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
        inertia = {key: float(tensor[at]) for key, at in keys.items()}
        mass, com = float(model.body_mass[body]), model.body_ipos[body].tolist()
        links.append({"name": model.body(body).name, "mass": mass, "com": com, **inertia})
    for j in range(1, model.njnt):
        body, dof, limit = model.jnt_bodyid[j], model.jnt_dofadr[j], speed.get(model.joint(j).name)
        joint = {
            "name": model.joint(j).name,
            "parent": model.body(model.body_parentid[body]).name,
            "child": model.body(body).name,
            "xyz": model.body_pos[body].tolist(),
            "rpy": _roll_pitch_yaw(model.body_quat[body]),
            "axis": model.jnt_axis[j].tolist(),
            "range": model.jnt_range[j].tolist(),
            "effort": _effort(model, j),
            "velocity": 0.0 if limit is None else float(limit.get("velocity", 0.0)),
        }
        drive = {"armature": model.dof_armature, "friction": model.dof_frictionloss, "viscous": model.dof_damping}
        joints.append(joint | {name: float(of_dofs[dof]) for name, of_dofs in drive.items() if of_dofs[dof]})
    frames = {
        model.site(i).name: {
            "parent": model.body(model.site_bodyid[i]).name,
            "xyz": model.site_pos[i].tolist(),
            "turned": math.degrees(2.0 * math.acos(min(1.0, abs(model.site_quat[i, 0])))),
        }
        for i in range(model.nsite)
    }
    return {"joints": joints, "links": links, "frames": frames, "coupled": coupled}


def _roll_pitch_yaw(quaternion: np.ndarray) -> list[float]:
    """Return a rotation as URDF's roll, pitch, yaw [rad]; with a pitch of 90 degrees, yaw is free and roll fits it."""
    yaw = float(rotations.yaw_of(quaternion))
    axes = rotations.rotation_z(-yaw) @ rotations.to_matrix(quaternion)
    return [math.atan2(-axes[1, 2], axes[1, 1]), math.atan2(-axes[2, 0], axes[0, 0]), yaw]


def _effort(model: mujoco.MjModel, j: int) -> float:
    """Return the torque limit of a joint, the least of its own and those of its actuators [N m]; 0 if none."""
    limits = [float(model.jnt_actfrcrange[j, 1])]
    for i in np.flatnonzero((model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (model.actuator_trnid[:, 0] == j)):
        gear = abs(float(model.actuator_gear[i, 0]))
        limits.append(gear * float(model.actuator_forcerange[i, 1]))
        if model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE:  # a motor, whose control is its torque
            limits.append(gear * float(model.actuator_gainprm[i, 0] * model.actuator_ctrlrange[i, 1]))
    return min((limit for limit in limits if limit > 0.0), default=0.0)


def _weighed_by_shapes(body: mujoco.MjsBody) -> bool:
    """Return whether an MJCF leaves the mass of a body to its shapes, which are not read here."""
    return not body.explicitinertial and any(geom.mass != 0.0 and geom.density != 0.0 for geom in body.geoms)


def _spec(file: pathlib.Path) -> mujoco.MjSpec:
    """Return what a file describes, on a floating root."""
    try:
        spec = mujoco.MjSpec.from_file(str(file))
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{file} is no URDF or MJCF that MuJoCo reads: {' '.join(str(error).split())}") from error
    roots = spec.worldbody.bodies
    if len(roots) != 1:
        names = ", ".join(body.name for body in roots) or "nothing"
        raise ModelError(f"{file} has {names} in the world; give one robot, whose other links hang on its base")
    if not roots[0].joints:
        roots[0].add_freejoint()
    for number, body in enumerate(spec.bodies[1:]):
        if not body.name and not body.joints:  # a part of the link that carries it
            body.name = f"part_{number}_of_{body.parent.name}"
    return spec


def _keep(spec: mujoco.MjSpec, kept: list[mujoco.MjsGeom]) -> None:
    """Remove all shapes but those to keep, and everything that may refer to the others."""
    used = {geom.meshname for geom in kept}
    shapes = [geom for geom in spec.geoms if geom not in kept]
    meshes = [mesh for mesh in spec.meshes if mesh.name not in used]
    for part in (*spec.geoms, *spec.sites, *spec.tendons):
        part.material = ""
    looks = (*spec.materials, *spec.textures)  # whose files may be missing, too
    for part in (*shapes, *meshes, *looks, *spec.keys, *spec.sensors, *spec.excludes, *spec.pairs):
        spec.delete(part)


def _compile(spec: mujoco.MjSpec, file: pathlib.Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        text = f"MuJoCo refuses {file}: {' '.join(str(error).split())}"
        if "balanceinertia" in text:
            text += (
                "; write <compiler balanceinertia='true'/> into it, in a URDF inside <mujoco>: the means of the moments"
            )
        raise ModelError(text) from error


def measure_sole(file: pathlib.Path, foot: str) -> dict[str, Any]:
    """Return the lowest part of a foot's shapes: x and y ranges and least z in its link, to a millimetre [m]."""
    spec = _spec(file)
    _keep(spec, [geom for geom in spec.geoms if _carrier(geom.parent).name == foot])
    spec.compiler.fusestatic = True
    # MuJoCo leaves the folders of a URDF's meshes out.
    given = {pathlib.Path(row.get("filename", "")) for row in ET.parse(file).iter("mesh")}  # noqa: S314  the user's
    for mesh in spec.meshes:
        wanted = next((path for path in given if path.name == mesh.file), pathlib.Path(spec.meshdir, mesh.file))
        mesh.file = str(_mesh(file, wanted) or mesh.file)
    try:
        model = _compile(spec, file)
    except ModelError as error:
        raise ModelError(
            f"{error}; without meshes, give the field sole: {{x: [heel, toe], y: [right, left], z: height}}"
        ) from error
    points = [_lowest(model, geom) for geom in range(model.ngeom)]
    if not points:
        raise ModelError(f"{file} has no shape of {foot}; give the field sole: {{x: [heel, toe], y: [right, left], z}}")
    for geom in np.flatnonzero(model.geom_type == _SHAPES.mjGEOM_BOX):
        tilt = math.degrees(math.acos(min(1.0, np.abs(rotations.to_matrix(model.geom_quat[geom])[2]).max())))
        if tilt > _TILTED:
            raise ModelError(
                f"the sole of {foot} is tilted by {tilt:.0f} degrees to the link's axes, and is to be level with them; "
                "turn the link in the description, and its shapes, inertia and joint axis back"
            )
    cloud = np.concatenate(points)
    low = cloud[cloud[:, 2] < cloud[:, 2].min() + _SOLE_DEPTH]
    (x0, y0, z), (x1, y1, _) = low.min(0).round(3).tolist(), low.max(0).round(3).tolist()
    return {"x": [x0, x1], "y": [y0, y1], "z": z}


def _mesh(file: pathlib.Path, wanted: pathlib.Path) -> pathlib.Path | None:
    """Return the path of a mesh: as the description says, or else the best match below its folder.

    The best match shares most of the path from its end. None if there is no file of that name.
    """
    if (direct := file.parent / wanted).is_file():
        return direct.resolve()

    def shared(found: pathlib.Path) -> int:
        pairs = zip(reversed(found.parts), reversed(wanted.parts), strict=False)
        return sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs))

    found = sorted(file.parent.rglob(wanted.name))
    most = max(map(shared, found), default=0)
    best = [path for path in found if shared(path) == most]
    if len({path.read_bytes() for path in best}) > 1:
        names = ", ".join(str(path.relative_to(file.parent)) for path in best)
        raise ModelError(f"{file} names the mesh {wanted.name}, and there are {names}; leave the right one alone there")
    return best[0].resolve() if best else None


def _carrier(body: mujoco.MjsBody) -> mujoco.MjsBody:
    """Return the body itself if a joint moves it, else the next one above that a joint moves."""
    return body if body.joints or not body.parent else _carrier(body.parent)


def outline(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the vertices of a mesh, or the corners of the box around another shape, in its frame [m], (n, 3)."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        first, count = model.mesh_vertadr[model.geom_dataid[geom]], model.mesh_vertnum[model.geom_dataid[geom]]
        return model.mesh_vert[first : first + count]
    return CORNERS * model.geom_aabb[geom, 3:] + model.geom_aabb[geom, :3]


def _cloud(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the outline of a shape in its body's frame [m], shape (n, 3)."""
    return outline(model, geom) @ rotations.to_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]


def _lowest(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the points of a shape that can touch a floor, in its body's frame [m], shape (n, 3).

    A ball and the ends of a capsule touch a floor only below their centres, however wide they are.
    """
    kind = _SHAPES(int(model.geom_type[geom]))
    if kind not in (_SHAPES.mjGEOM_SPHERE, _SHAPES.mjGEOM_CAPSULE):
        return _cloud(model, geom)
    radius, half, _ = model.geom_size[geom]
    along = rotations.to_matrix(model.geom_quat[geom])[:, 2] * half * (kind != _SHAPES.mjGEOM_SPHERE)
    return model.geom_pos[geom] + np.array([along, -along]) - [0.0, 0.0, radius]


def collision_boxes(file: pathlib.Path) -> dict[str, dict[str, list[float]]]:
    """Return the box around each link's collision shapes, in its frame [m], if each shape is one of `_SIMPLE`."""
    spec = _spec(file)
    shapes = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
    simple = [geom for geom in shapes if geom.type in _SIMPLE and not geom.meshname]
    others = {geom.parent.name for geom in shapes if geom not in simple}
    _keep(spec, simple)
    spec.compiler.fusestatic = False
    model = _compile(spec, file)
    # A body that is fixed to another counts as a part of it.
    left_out = {0, *(model.body_weldid[model.body(name).id] for name in others)}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    clouds: dict[int, list[np.ndarray]] = {}
    for geom, body in enumerate(model.geom_bodyid):
        link = model.body_weldid[body]
        world = _cloud(model, geom) @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
        clouds.setdefault(int(link), []).append((world - data.xpos[link]) @ data.xmat[link].reshape(3, 3))
    boxes = {}
    for link, points in clouds.items():
        if link in left_out:
            continue
        low, high = (of(np.concatenate(points), axis=0) for of in (np.min, np.max))
        boxes[model.body(link).name] = {"center": ((low + high) / 2).tolist(), "size": (high - low).tolist()}
    return boxes
