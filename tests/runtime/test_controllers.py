import importlib.metadata
import pathlib
import shutil
import tomllib

import pytest

import hugwbc
from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError, HugwbcError, PolicyFileError, UnknownNameError
from hugwbc.learned.policy import policy_file
from hugwbc.robot import load_robot
from hugwbc.robot_tables import DEFAULT_ROBOT, robot_names
from hugwbc.runtime import controllers, rollout
from hugwbc.runtime.controllers import GROUP, ControllerSpec, HoldController, controller_names, load_controller, plugins
from hugwbc.sim import Arena, Simulation

CONTRACT = "period: 0.02\njoints: all\ndefault_pose: 0\nkp: 1\nkd: 1\naction_scale: 1\nobservation: [gravity]\n"


def arena_of(robot, drives="real"):
    return Arena(robot, drives, "exact", "firm")


class Tuned(HoldController):
    """A third party's controller, which takes a file."""

    name = "tuned"

    def __init__(self, policy=None):
        super().__init__()
        self.policy = policy


@pytest.fixture
def third_party(monkeypatch):
    """Registers entry points as an installed package does."""

    def register(**entries):
        made = [importlib.metadata.EntryPoint(name, value, GROUP) for name, value in entries.items()]
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: made if group == GROUP else [])
        plugins.cache_clear()

    yield register
    monkeypatch.undo()
    plugins.cache_clear()


@pytest.fixture
def theirs(tmp_path):
    """The contract of a policy of others, without a network."""
    (tmp_path / "theirs.yaml").write_text(CONTRACT)
    return str(tmp_path / "theirs.yaml")


def test_ours_are_registered_as_in_pyproject():
    path = pathlib.Path(hugwbc.__file__).parent.parent / "pyproject.toml"
    registered = tomllib.loads(path.read_text())["project"]["entry-points"][GROUP]
    assert {name: entry.value for name, entry in plugins().items() if name in registered} == registered
    assert controller_names()[:3] == ("learned", "qp", "hold") and "unitree-h1" in controller_names()


def test_a_controller_by_name_is_told_the_robot_that_moves():
    trace = rollout("hold", Command(), Simulation(robot=load_robot("g1"), sensing="exact"), duration=0.1)
    assert trace.robot == "g1" and not trace.safety.failures and not trace.safety.bad_states


def test_a_controller_is_told_a_robot_by_name():
    for name in ("qp", "hold"):
        for robot in robot_names():
            assert load_controller(name, robot=robot).robot is load_robot(robot)
        assert load_controller(name).robot is load_robot()
    assert load_controller("qp", robot="h1").dynamics.mass == pytest.approx(load_robot("h1").mass)
    spec, twin = ControllerSpec("qp", robot="h1-2023"), ControllerSpec("qp", robot="h1")
    other = next(name for name in robot_names() if name != DEFAULT_ROBOT)
    assert ControllerSpec("qp").told(arena_of(other)) == ControllerSpec("qp", robot=other)
    assert twin.label == "qp h1"
    assert ControllerSpec("qp").told(arena_of(DEFAULT_ROBOT)) == ControllerSpec("qp"), "it knows the default already"
    assert spec.identity() != twin.identity()
    assert ControllerSpec("qp").identity() == ControllerSpec("qp", robot=DEFAULT_ROBOT).identity()
    with pytest.raises(UnknownNameError, match="robot"):
        ControllerSpec("qp", robot="g9")


def test_a_controller_is_told_the_drives_by_name():
    real, ideal = (load_controller("qp", drives=drives).robot for drives in ("real", "ideal"))
    assert real is load_robot() and real.friction.all() and not ideal.friction.any() and ideal.name == real.name
    told = ControllerSpec("qp").told(arena_of(DEFAULT_ROBOT, "ideal"))
    assert told == ControllerSpec("qp", drives="ideal") and told.label == "qp ideal drives"
    assert told.identity() != ControllerSpec("qp").identity() == ControllerSpec("qp", drives="real").identity()
    assert told.told(arena_of(DEFAULT_ROBOT)) == ControllerSpec("qp"), "told again, it forgets what it was told before"
    with pytest.raises(UnknownNameError, match="drives"):
        ControllerSpec("qp", drives="geared")


@pytest.mark.parametrize(("name", "policy"), [("learned", "h1"), ("unitree-h1", None)])
def test_a_policy_is_told_no_robot(name, policy):
    assert ControllerSpec(name).told(arena_of("h1-2023", "ideal")) == ControllerSpec(name)
    with pytest.raises(ConfigError, match=f"controller '{name}' is not told a robot: .* leave out 'h1-2023'"):
        load_controller(name, policy, robot="h1-2023")
    with pytest.raises(ConfigError, match=f"controller '{name}' is not told a robot: .* leave out 'ideal'"):
        load_controller(name, drives="ideal")


@pytest.mark.parametrize(("name", "policy"), [("learned", "h1"), ("unitree-h1", None), ("leggedlab-h1", None)])
def test_a_policy_refuses_another_robot_by_name(name, policy):
    message = f"policy '{policy or name}' is for the robot h1, and this is g1; choose --robot h1, or train one for g1: "
    with pytest.raises(ConfigError, match=message):
        ControllerSpec(name, policy).told(arena_of("g1"))
    with pytest.raises(ConfigError, match=message):
        load_controller(name, policy, robot="g1")


def test_the_learned_controller_of_a_robot_is_its_shipped_policy():
    for robot, policy in (("h1", "h1"), ("h1-2023", "h1"), ("g1", "g1")):
        assert load_controller("learned", robot=robot).contract == load_controller("learned", policy).contract
    with pytest.raises(ConfigError, match=r"is not told a robot: .* leave out 'ideal'"):
        load_controller("learned", robot="g1", drives="ideal")


def test_plugins_that_do_not_work_are_refused(third_party):
    third_party(broken="no_such_module:Controller", wrong="pathlib:Path")
    with pytest.raises(ConfigError, match=r"controller 'broken' .* cannot be loaded: ModuleNotFoundError: No module"):
        ControllerSpec("broken").build()
    with pytest.raises(ConfigError, match="gives a PosixPath without period, reset, act"):
        ControllerSpec("wrong").build()
    third_party(qp="somebody:Else")
    with pytest.raises(ConfigError, match="two controllers are registered as 'qp'"):
        ControllerSpec("qp")


def test_a_folder_without_a_policy_is_told_from_a_damaged_policy(tmp_path, monkeypatch):
    (tmp_path / "balancer").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"no installed package registers .*'balancer'.* holds no policy"):
        ControllerSpec("balancer")


def test_a_policy_is_loaded_by_folder_or_file_and_other_paths_are_refused(tmp_path, theirs):
    shutil.copytree(policy_file("h1").parent, tmp_path / "mine")
    for path in (tmp_path / "mine", tmp_path / "mine" / "policy.safetensors"):
        assert ControllerSpec(str(path)).build().name == "learned"
    with pytest.raises(PolicyFileError, match="names no policy file"):
        ControllerSpec(theirs).build()
    for words in (("motion.pt",), ("learned", "motion.pt")):
        with pytest.raises(ConfigError, match="bare network; write a contract"):
            ControllerSpec(*words)
    with pytest.raises(HugwbcError, match=r"the path of a policy folder or file .*, or of a contract"):
        ControllerSpec(str(tmp_path / "nothing"))


def test_labels_tell_policies_apart(tmp_path, theirs):
    assert ControllerSpec("qp").label == "qp"
    assert ControllerSpec("learned", "runs/second").label == "learned second"
    assert ControllerSpec(theirs).label == "theirs"
    shutil.copytree(policy_file("h1").parent, tmp_path / "lr0.5")
    assert ControllerSpec(str(tmp_path / "lr0.5")).label == "lr0.5", "a folder has no suffix"
    assert ControllerSpec("learned", tmp_path / "lr0.5").label == "learned lr0.5"
    assert ControllerSpec("learned", tmp_path / "lr0.5" / "policy.safetensors").label == "learned policy"


def test_the_training_is_what_the_policys_file_says(theirs):
    assert ControllerSpec("learned").training == "noise" == ControllerSpec(str(policy_file("h1").parent)).training
    assert ControllerSpec("qp").training is None
    assert ControllerSpec(theirs, "net.pt").training is None


def test_identity_is_that_of_the_files(tmp_path, theirs):
    default = ControllerSpec("learned").identity()
    shutil.copytree(policy_file("h1").parent, tmp_path / "copy")
    copy = ControllerSpec("learned", tmp_path / "copy").identity()
    assert copy == default and len(default["files"]) == 1
    assert ControllerSpec("qp").identity() == {
        "name": "qp", "package": default["package"], "files": [],
        "policy": None, "robot": DEFAULT_ROBOT, "drives": "real",
    }  # fmt: skip
    network = tmp_path / "net.pt"
    network.write_bytes(b"a")
    spec = ControllerSpec(theirs, str(network))
    before = spec.identity()
    assert len(before["files"]) == 2
    network.write_bytes(b"b")
    assert spec.identity() != before


def test_a_source_tree_that_is_not_installed_has_an_identity(monkeypatch):
    def nothing_installed(name):
        raise importlib.metadata.PackageNotFoundError(name)

    installed = ControllerSpec("learned").identity()
    monkeypatch.setattr(importlib.metadata, "version", nothing_installed)
    assert ControllerSpec("learned").identity() == installed


def test_a_policy_for_what_takes_none_is_refused(theirs):
    for name in ("hold", "qp"):
        with pytest.raises(ConfigError, match=f"controller '{name}' takes no policy"):
            ControllerSpec(name, "h1")
    with pytest.raises(ConfigError, match="takes no policy because it is one"):
        ControllerSpec(str(policy_file("h1").parent), "h1")
    with pytest.raises(ConfigError, match="takes no policy"):
        ControllerSpec.parse("qp=h1")
    assert ControllerSpec(theirs, "net.pt").policy == "net.pt"


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_a_folder_with_the_name_of_a_shipped_policy_is_none(robot, tmp_path, monkeypatch):
    """Such as the run of a recipe, where the next command is given."""
    shipped = ControllerSpec("learned").told(arena_of(robot)).files()
    (tmp_path / robot).mkdir()
    shutil.copy(policy_file("g1" if robot == "h1" else "h1"), tmp_path / robot / "policy.safetensors")
    monkeypatch.chdir(tmp_path)
    assert ControllerSpec("learned").told(arena_of(robot)).files() == shipped == [policy_file(robot)]
    for own in (f"./{robot}", str(tmp_path / robot)):
        (file,) = ControllerSpec("learned", own).files()
        assert file.samefile(tmp_path / robot / "policy.safetensors")
    assert policy_file(pathlib.Path(robot)) == pathlib.Path(robot) / "policy.safetensors"


def test_whatever_a_plugin_takes_as_policy_tells_its_results_apart(third_party, monkeypatch, tmp_path):
    monkeypatch.setattr(controllers, "Tuned", Tuned, raising=False)
    third_party(tuned="hugwbc.runtime.controllers:Tuned")
    folder = tmp_path / "weights"
    folder.mkdir()
    (folder / "a").write_bytes(b"a")
    found = [ControllerSpec("tuned", policy).identity() for policy in (None, "small", "large", str(folder))]
    (folder / "b").write_bytes(b"b")
    found.append(ControllerSpec("tuned", str(folder)).identity())
    assert all(one != other for index, one in enumerate(found) for other in found[:index])


ABILITIES = {"phase", "footholds", "planned_acceleration", "stop"}


@pytest.mark.parametrize(
    ("name", "expected"), [("qp", ABILITIES - {"stop"}), ("learned", {"phase", "stop"}), ("hold", set())]
)
def test_the_members_of_a_controller_say_what_it_has(name, expected):
    controller = load_controller(name)
    assert isinstance(controller, Controller) and controller.name == name
    assert {ability for ability in ABILITIES if hasattr(controller, ability)} == expected
