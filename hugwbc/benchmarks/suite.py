"""All benchmarks in one run: training, controllers, hand IK and reachable workspace."""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

from hugwbc.errors import ConfigError

if TYPE_CHECKING:
    from hugwbc.benchmarks.hand_ik import IKFigures
    from hugwbc.benchmarks.speed import EnvironmentSpeed, EpisodeSpeed, QpSpeed, TrainingSpeed
    from hugwbc.upper_ik.workspace import Workspace


@dataclasses.dataclass(frozen=True)
class BenchSettings:
    """Sizes of the benchmarks."""

    count: int = 1024
    """Robots in training."""
    control_steps: int = 50
    """Steps of the training environment to measure."""
    iterations: int = 2
    """Training iterations to measure, of 24 control steps and one update each."""
    threads: int = 1
    """Threads of training, its environment and bare physics; controllers and IK use one."""
    seconds: float = 4.0
    """Simulated time over which the QP is measured, standing, walking and jumping each, and every episode [s]."""
    calls: int = 500
    """Calls of the policy and of the IK to measure."""
    ik_targets: int = 20
    """Targets for our IK, mink and pink, 3 s each; mink and pink take part where they are installed."""
    spacing: float = 0.25
    """Spacing of the grid in a 2 m cube on which the reachable workspace is measured [m]."""

    def check(self) -> None:
        """Check the values before any work."""
        counts = ("count", "control_steps", "iterations", "threads", "calls", "ik_targets")
        for name in (*counts, "seconds", "spacing"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} is {getattr(self, name)}; give a value above 0")
        if self.ik_targets < 2:
            raise ConfigError(
                f"ik_targets is {self.ik_targets}; give 2 or more: targets within and out of reach alternate"
            )
        from hugwbc.upper_ik.workspace import check_spacing

        check_spacing(self.spacing)


@dataclasses.dataclass(frozen=True)
class BenchFigures:
    """Figures of all benchmarks.

    Attributes:
        environment: speed of the training environment.
        training: speed of training.
        qp: speed of `qp`, by gait.
        episodes: speed of an episode with everything in the loop, by controller and activity.
        policy_tick_ms, ik_tick_ms: p50 and p99 of one call of the policy and of the hand IK [ms].
        ik: the inverse kinematics solvers, by name.
        workspace: reachable part of a cube around the robot.
        threads: threads of training, its environment and bare physics.
    """

    environment: "EnvironmentSpeed"
    training: "TrainingSpeed"
    qp: dict[str, "QpSpeed"]
    episodes: dict[str, "EpisodeSpeed"]
    policy_tick_ms: dict[str, float | None]
    ik_tick_ms: dict[str, float | None]
    ik: dict[str, "IKFigures"]
    workspace: "Workspace"
    threads: int


def run_benchmarks(settings: BenchSettings, on_progress: Callable[[float], None] | None = None) -> BenchFigures:
    """Run all benchmarks.

    Args:
        settings: sizes of the benchmarks.
        on_progress: called with the fraction done.
    """
    settings.check()
    # Loads torch and the controllers.
    from hugwbc.benchmarks import speed
    from hugwbc.benchmarks.hand_ik import compare_solvers
    from hugwbc.learned.policy import load_policy
    from hugwbc.runtime import load_controller
    from hugwbc.upper_ik.workspace import measure_workspace

    advance = on_progress or (lambda fraction: None)
    environment = speed.environment_speed(settings.count, settings.control_steps, settings.threads)
    advance(0.05)
    bare = environment.bare_steps_per_s
    training = speed.training_speed(bare, settings.count, settings.iterations, settings.threads)
    advance(0.2)
    qp = {gait: speed.qp_speed(command, settings.seconds) for gait, command in speed.COMMANDS.items()}
    advance(0.3)
    policy = load_policy()
    episodes = {
        f"{name}, {activity}": speed.episode_speed(controller, activity, settings.seconds)
        for name, controller in (("qp", load_controller("qp")), ("policy", policy))
        for activity in speed.ACTIVITIES
    }
    policy_tick, ik_tick = speed.policy_tick(policy, settings.calls), speed.ik_tick(settings.calls)
    solvers = compare_solvers(settings.ik_targets, on_progress=lambda fraction: advance(0.3 + 0.4 * fraction))
    workspace = measure_workspace(settings.spacing, on_progress=lambda fraction: advance(0.7 + 0.3 * fraction))
    return BenchFigures(
        environment,
        training,
        qp,
        episodes,
        policy_tick,
        ik_tick,
        solvers,
        workspace,
        settings.threads,
    )
