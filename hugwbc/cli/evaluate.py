"""`hugwbc evaluate`: one of the protocols, for any controller, on level or rough ground, arms free or moved."""

import dataclasses
import functools
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

from hugwbc.cli import descriptions
from hugwbc.cli.output import check_folder, check_writable, parse, progress, say, write_json
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation import protocols
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import DEFAULT_FOLDER, Execution, ResultStore
from hugwbc.gait import Gait
from hugwbc.runtime.controllers import ControllerSpec

_SIZES = ("episodes", "samples", "points", "rollouts")  # options that say how many episodes there are


@dataclasses.dataclass(frozen=True)
class EvaluateOptions:
    """Run a protocol and print the errors beside the paper's figures, or where the robot falls."""

    controller: str = "learned"
    """learned, qp, hold (the baseline that only holds its pose), a plug-in's name, or the path of a policy or
    of a contract for somebody else's (docs/evaluation.md)."""
    policy: str | None = None
    """Name of a shipped policy or path of a policy, for the learned controller; of a network, for somebody else's."""
    gait: str | None = None
    """standing, walking, jumping, hopping_left, hopping_right, or hopping: left and right leg in turn. By default
    walking, and standing where the protocol is about it."""
    protocol: str = "single-command"
    """Which experiment (docs/evaluation.md):
    single-command: each command over its range, alone.
    random-commands: all commands at once; where it falls.
    small-velocities: which part of 0.1 to 0.3 m/s is walked.
    hands: from one reachable target to the next.
    intervention: arms moved by noise, motions, nothing.
    foot-displacement: of a stand with the arms so moved.
    contacts: of the feet, against the gait's clock.
    ramp: p and w from minimum to maximum.
    disturbance: the largest force that a stand survives.
    heatmap: errors over each pair of commands.
    robustness: payload, friction, latency, motors, ground.
    tour: 12 waypoints, arms moved, a blow on each leg.
    effort: cost of transport, limits, time of a tick."""
    v_x: float = 0.5
    """Forward velocity in the hands and contacts protocols, for gaits that move [m/s]."""
    blow: float | None = None
    """The strongest in the tour protocol, on a G1 [N]; 0 for none."""
    training: str | None = None
    """Which of the paper's policies stands beside in the protocols of intervention: that trained with noise,
    motion or none; by default as the policy's own file says, and noise without one."""
    intervention: str = "none"
    """What moves the arms in every episode: none, noise (uniform targets every 1.8 s) or motion (motion files)."""
    motions: pathlib.Path | None = None
    """Folder of motion files (.npz) for --intervention motion; without one, generated motions."""
    terrain_roughness: float = 0.0
    """Half-width of the random height of the ground [m], such as 0.02; 0 for a plane."""
    slope: float = 0.0
    """Angle at which the ground rises along the robot's first heading [rad], such as 0.087."""
    episodes: int | None = None
    """Episodes in all, in some protocols of each kind; by default the protocol's."""
    samples: int | None = None
    """Episodes of each value in the robustness protocol."""
    points: int | None = None
    """Values of each command in the heatmap protocol."""
    rollouts: int | None = None
    """Of each force in the disturbance protocol; the paper's figure has 4096."""
    seed: int = 0
    """Of the sampled commands, the ground and the arms."""
    duration: float | None = None
    """Length of an episode [s]; by default the protocol's, 10 in most."""
    settle: float | None = None
    """Start of an episode that is left out of the errors [s]; by default 1, and 2 in the hands protocol."""
    timestep: float = 0.002
    """Of the physics [s]; 0.005, the training's, is faster and enough for the learned controller."""
    noise: bool = False
    """Give the sensors a real robot's noise and latency, and estimate the state from them."""
    workers: int = 1
    """Processes that share the episodes; the hands protocol runs in one."""
    cluster: str | None = None
    """Address of a Dask scheduler, such as tcp://127.0.0.1:8786, whose workers share the episodes instead."""
    results: pathlib.Path | None = DEFAULT_FOLDER
    """Folder where finished episodes are kept, and read from when they are asked for again; None keeps none, nor does
    the hands protocol."""
    fresh: bool = False
    """Run all episodes anew; the files of earlier results are kept under other names."""
    json: pathlib.Path | None = None
    """Write the result to this file; without a path, to standard output."""

    def conditions(self) -> Conditions:
        """The conditions of all episodes."""
        return Conditions(
            timestep=self.timestep,
            terrain_roughness=self.terrain_roughness,
            slope=self.slope,
            noise=self.noise,
            intervention=self.intervention,
            motions=None if self.motions is None else str(self.motions),
        )

    @functools.cached_property
    def execution(self) -> Execution:
        """Where the episodes run, and where their results are kept."""
        store = None if self.results is None else ResultStore(self.results, fresh=self.fresh)
        return Execution(self.workers, cluster=self.cluster, store=store)

    def given(self, *names: str) -> dict[str, Any]:
        """Options by name, without those that are left to the protocol."""
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def refuse_other_sizes(self, own: Sequence[str]) -> None:
        """Refuse a number of episodes that the protocol has no use for.

        Raises:
            ConfigError: naming it and the protocol's own.
        """
        for name in _SIZES:
            if name not in own and getattr(self, name) is not None:
                sizes = " and ".join(f"--{size}" for size in own if size in _SIZES) or "none: its size is fixed"
                raise ConfigError(f"--{name} means nothing to the {self.protocol} protocol; it takes {sizes}")

    def settings(self) -> dict[str, Any]:
        """Settings of any protocol."""
        own = {"conditions": self.conditions(), "execution": self.execution}
        return {**self.given("seed", "duration", "settle"), **own}


@dataclasses.dataclass(frozen=True)
class _Protocol:
    """How to run a protocol from the command line.

    Attributes:
        config: makes its settings from the options.
        run: called with the controller's factory, the settings, and what to call after each episode.
        describe: the result as text.
    """

    config: Callable[[EvaluateOptions], Any]
    run: Callable[..., Any]
    describe: Callable[[Any], str]


def _one_gait(config: type[Any], *names: str, default: Gait = Gait.WALKING) -> Callable[[EvaluateOptions], Any]:
    """Settings of a protocol of one gait, or of hopping on both legs; `names` of the options of its own."""

    def build(options: EvaluateOptions) -> Any:  # noqa: ANN401  each protocol has its own type
        options.refuse_other_sizes(names)
        both_legs = options.gait == "hopping"
        gait = Gait.HOPPING_LEFT if both_legs else Gait.parse(options.gait or default.label)
        return config(gait, both_legs=both_legs, **options.given(*names), **options.settings())

    return build


def _hands(options: EvaluateOptions) -> protocols.HandsConfig:
    options.refuse_other_sizes(["episodes"])
    given = {"--workers": options.workers != 1, "--cluster": options.cluster is not None, "--fresh": options.fresh}
    if any(given.values()):
        names = ", ".join(name for name, there in given.items() if there)
        raise ConfigError(f"the hands protocol runs in one process and keeps no episodes; leave out {names}")
    return protocols.HandsConfig(
        gait=Gait.parse(options.gait or "walking"),
        conditions=options.conditions(),
        **options.given("v_x", "episodes", "seed", "duration", "settle"),
    )


_PROTOCOLS = {
    "single-command": _Protocol(
        _one_gait(protocols.SingleCommandConfig, "episodes"),
        protocols.run_single_command,
        descriptions.describe_single,
    ),
    "random-commands": _Protocol(
        _one_gait(protocols.RandomCommandsConfig, "episodes"),
        protocols.run_random_commands,
        descriptions.describe_random,
    ),
    "small-velocities": _Protocol(
        _one_gait(protocols.SmallVelocitiesConfig, "episodes"),
        protocols.run_small_velocities,
        descriptions.describe_small,
    ),
    "intervention": _Protocol(
        _one_gait(protocols.InterventionConfig, "episodes", "training"),
        protocols.run_intervention,
        descriptions.describe_intervention,
    ),
    "foot-displacement": _Protocol(
        _one_gait(protocols.FootDisplacementConfig, "episodes", "training", default=Gait.STANDING),
        protocols.run_foot_displacement,
        descriptions.describe_foot_displacement,
    ),
    "contacts": _Protocol(
        _one_gait(protocols.ContactsConfig, "episodes", "v_x"), protocols.run_contacts, descriptions.describe_contacts
    ),
    "ramp": _Protocol(_one_gait(protocols.RampConfig, "episodes"), protocols.run_ramp, descriptions.describe_ramp),
    "disturbance": _Protocol(
        _one_gait(protocols.DisturbanceConfig, "rollouts", default=Gait.STANDING),
        protocols.run_disturbance,
        descriptions.describe_disturbance,
    ),
    "heatmap": _Protocol(
        _one_gait(protocols.HeatmapConfig, "points"), protocols.run_heatmap, descriptions.describe_heatmap
    ),
    "robustness": _Protocol(
        _one_gait(protocols.RobustnessConfig, "samples"), protocols.run_robustness, descriptions.describe_robustness
    ),
    "tour": _Protocol(
        _one_gait(protocols.TourConfig, "episodes", "blow"), protocols.run_tour, descriptions.describe_tour
    ),
    "effort": _Protocol(_one_gait(protocols.EffortConfig), protocols.run_effort, descriptions.describe_effort),
    "hands": _Protocol(_hands, protocols.run_hands, descriptions.describe_hands),
}


def run(words: Sequence[str]) -> int:
    """Parse, run, print, write."""
    options = parse(EvaluateOptions, words, "evaluate", EvaluateOptions.__doc__)
    if options.protocol not in _PROTOCOLS:
        raise UnknownNameError("protocol", options.protocol, _PROTOCOLS)
    protocol, spec = _PROTOCOLS[options.protocol], ControllerSpec(options.controller, options.policy)
    if options.training is None and options.protocol in ("intervention", "foot-displacement"):
        options = dataclasses.replace(options, training=spec.training)
    config = protocol.config(options)
    if options.results is not None and options.protocol != "hands":  # which keeps no episodes
        check_folder(options.results)
    check_writable(options.json)
    done = 0
    with progress(f"{options.controller}, {options.protocol}: {config.episodes} episodes") as advance:

        def on_episode(_: object) -> None:
            nonlocal done
            done += 1
            read = 0 if options.execution.store is None else options.execution.store.restored
            advance(*(min(count / config.episodes, 1.0) for count in (done, min(done, read))))

        with options.execution:
            result = protocol.run(spec.build, config, on_episode)
    say(protocol.describe(result), options.json)
    content = dataclasses.asdict(result)
    rows = content.pop("rows")
    write_json(options.json, {**content, "rows": rows})  # the summary before what may be thousands of lines
    return 0
