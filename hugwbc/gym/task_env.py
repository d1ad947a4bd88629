"""A task of the suite as a gymnasium environment: commands and hand targets in, observations out, at 10 Hz."""

import math
import pathlib
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces

from hugwbc.behaviours import Behaviour
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.gym import check_no_options
from hugwbc.gym.episode import PERIOD, Episode, FollowRow
from hugwbc.gym.task_action import ActionLayout, RecordedLayout
from hugwbc.gym.task_observation import LARGEST, ObservationLayout
from hugwbc.numeric import floats
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.scripts.view import View
from hugwbc.sim import Arena, Scene, Simulation, load_scene
from hugwbc.sim.scenes import Box
from hugwbc.tasks import Task, Verdict, load_task, shapes_of
from hugwbc.tasks.demonstration import OBJECTS, STATE, objects_array, state_names, state_vector
from hugwbc.upper_ik import UpperBodySource

SUCCESS_TIME = 1.0  # [s], for which everything has to stay as it should be, since things may still tip over
_TOO_LATE = f"done for less than {SUCCESS_TIME:g} s"
_FIRST_SEED, _LAST_SEED = 3000, 2**31 - 1  # of episodes that get no seed: free ones (docs/evaluation.md)


class TaskEnv(gymnasium.Env[Any, np.ndarray]):
    """One episode after another of a task.

    The reward of a step is by how much the task's score has grown in it; it is negative where the score falls. The sum
    over an episode is the final score, 1 for a success, less what the score was at the start: 0 in every shipped task.

    Attributes:
        task: the task.
        actions: order, units and ranges of the numbers of an action.
        observations: order of the numbers of an observation.
    """

    metadata = {"render_modes": [], "render_fps": 10}  # noqa: RUF012  as gymnasium declares it

    def __init__(
        self,
        task: str | Task,
        controller: str = "learned",
        *,
        policy: str | None = None,
        actions: Literal["scaled", "recorded"] = "scaled",
        scene: Scene | str | pathlib.Path | None = None,
        limit: float | None = None,
        arena: Arena | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Build controller, arms and estimator; the scene is drawn by `reset`.

        Args:
            task: one of the suite, the path of a Python file with a TASK, or a task.
            controller: name or path, as on the command line; it does what the actions ask for.
            policy: of the controller.
            actions: "recorded" for steps of 0.02 s with the actions and observations of recordings
                (docs/demonstrations.md); "scaled" for steps of 0.1 s with numbers from -1 to 1.
            scene: objects instead of the task's own, by the same names; a name or path of a scene is loaded.
            limit: duration after which an episode is truncated [s]; None for the task's.
            arena: robot, drives, sensors and ground; None for the default (docs/arena.md).
            render_mode: None; there is nothing to render.
        """
        if render_mode is not None:
            raise ConfigError(f"render_mode is {render_mode!r}; give None: watch an episode with `hugwbc play --task`")
        self._arena = arena or Arena()
        if not isinstance(self._arena, Arena):
            raise ConfigError(f"arena is {arena!r}; give an Arena, such as hugwbc.sim.Arena(robot='g1')")
        self.task = (task if isinstance(task, Task) else load_task(task)).sized(self._arena.known_robot)
        limit = self.task.limit if limit is None else limit
        if not PERIOD <= limit < math.inf:
            raise ConfigError(f"limit is {limit} s; give a finite time from {PERIOD} s")
        self.render_mode, self._limit = render_mode, limit
        self._scene = _scene_of(self.task, scene)
        self._controller = ControllerSpec(controller, policy).told(self._arena).build()
        if actions not in ("scaled", "recorded"):
            raise UnknownNameError("kind of actions", actions, ("scaled", "recorded"))
        self._recorded = actions == "recorded"
        self._ticks = _ticks_in(RECORD_PERIOD if self._recorded else PERIOD, self._controller.period, controller)
        self._arms = UpperBodySource(robot=self._arena.known_robot)
        self._simulation: Simulation | None = None
        self._episode: Episode | None = None
        robot_told, scene_told = self._arena.known_robot, self._scene
        grip = _grip_of(self.task, scene_told)
        self.actions = RecordedLayout(robot_told) if self._recorded else ActionLayout(grip, robot_told)
        self.observations = ObservationLayout(robot_told, scene_told.body_names, shapes_of(scene_told))
        largest = LARGEST if self._recorded else 1.0
        self.action_space = spaces.Box(-largest, largest, (len(self.actions.names),), np.float32)
        self.observation_space = spaces.Box(-LARGEST, LARGEST, (self.observations.size,), np.float32)
        if self._recorded:
            sizes = {STATE: (len(state_names(robot_told)),), OBJECTS: (7 * len(scene_told.body_names),)}
            self.observation_space = spaces.Dict(
                {key: spaces.Box(-LARGEST, LARGEST, size, np.float32) for key, size in sizes.items()}
            )

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: of what varies in the scene and of the sensors' errors, as in `hugwbc play --task NAME --seed SEED`.
                Without it, the next one is drawn.
            options: none are known, so that others than None and {} are refused.

        Returns:
            The observation, and `info` as `step` returns it.
        """
        check_no_options(options)
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(_FIRST_SEED, _LAST_SEED))
        self._seed = drawn if seed is None else seed
        if self._simulation is None:
            self._simulation = self._arena.simulation(scene=self._scene, seed=self._seed)
        else:
            self._simulation.redraw(self._seed)
        self._action = self.actions.rest.astype(float)
        self._episode = Episode(self.task, self._simulation, self._controller, self._arms, recorded=self._recorded)
        self._since = math.inf  # when everything came to be as it should be
        verdict = self._episode.judge()
        self._score = verdict.score
        return self._observation(self._episode), self._info(self._episode, verdict, "")

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do what an action asks for, for 0.1 s, or 0.02 s if it is a recorded one.

        Args:
            action: `actions.names`, each from -1 to 1 or in its unit. NaN repeats the last value, and values beyond are
                clamped.

        Returns:
            Observation, reward, whether the task is done or has failed, whether the time is over, and `info`:
            "score", "success", "reason" (why the episode ended, or what is missing so far), "detail", "time" [s] and
            "seed".
        """
        episode = self._running
        given = floats(action, self._action.shape)
        if given is None:
            shape = getattr(action, "shape", "unknown")
            raise ConfigError(f"the action has the shape {shape}; give {self._action.size} numbers")
        kept = np.where(np.isnan(given), self._action, given)
        self._action = np.clip(kept, self.action_space.low, self.action_space.high)
        episode.behaviour.wish = self.actions.decode(self._action)
        episode.advance(self._ticks)
        verdict = episode.judge()
        reward, self._score = verdict.score - self._score, verdict.score
        self._since = min(self._since, episode.time) if verdict.success else math.inf
        done = verdict.success and episode.time - self._since >= SUCCESS_TIME - 1e-9
        failed = bool(episode.fell or self._problems or episode.problem)
        over = episode.time >= self._limit - 1e-9
        ended = "done" if done else "failed" if failed else "time" if over else ""
        return self._observation(episode), reward, done or failed, over, self._info(episode, verdict, ended)

    @property
    def view(self) -> View:
        """The present view of a behaviour, for imitation."""
        return self._running.view

    @property
    def behaviour(self) -> Behaviour:
        """The task's own behaviour for robot and objects of this episode, for imitation."""
        assert self._running.simulation.scene is not None
        return self.task.behaviour_in(self._running.simulation.scene)

    @property
    def _running(self) -> Episode:
        if self._episode is None:
            raise ConfigError("there is no episode; call reset first")
        return self._episode

    def close(self) -> None:
        """Let go of the simulation."""
        self._simulation = self._episode = None

    @property
    def _problems(self) -> list[str]:
        assert self._simulation is not None
        return self._simulation.objects.problems

    def _observation(self, episode: Episode) -> Any:  # noqa: ANN401  of the observation space
        if isinstance(episode.behaviour, FollowRow):
            view, bodies = episode.view, self._scene.body_names
            seen = {STATE: state_vector(view), OBJECTS: objects_array(view, bodies).ravel()}
            return {key: value.astype(np.float32) for key, value in seen.items()}
        gone = episode.time / self._limit
        return self.observations.row(episode.view, episode.shapes, episode.behaviour.points, gone)

    def _info(self, episode: Episode, verdict: Verdict, ended: str) -> dict[str, Any]:
        missing = verdict.reason or episode.problem
        return {
            "score": verdict.score,
            "success": ended == "done",
            "reason": f"the time was over: {missing or _TOO_LATE}" if ended == "time" else missing,
            "detail": "; ".join(self._problems),
            "time": episode.time,
            "seed": self._seed,
        }


def _scene_of(task: Task, scene: Scene | str | pathlib.Path | None) -> Scene:
    """Return the objects of the episodes."""
    if scene is None:
        return task.scene
    given = scene if isinstance(scene, Scene) else load_scene(str(scene))
    missing = [name for name in task.scene.body_names if name not in given.body_names]
    if missing:
        raise ConfigError(f"the scene has no {', '.join(missing)}; task '{task.name}' needs objects of these names")
    return given


def _grip_of(task: Task, scene: Scene) -> str | None:
    """Return how hands grip in a task: idealised if it says so, by friction with boxes."""
    if "attach" in task.idealised:
        return "attach"
    return "squeeze" if any(isinstance(thing, Box) for thing in scene.objects) else None


def _ticks_in(duration: float, period: float, name: str) -> int:
    """Return how many control periods [s] are in a duration [s]."""
    ticks = round(duration / period)
    if ticks < 1 or abs(ticks * period - duration) > 1e-9:
        raise ConfigError(
            f"the period of controller '{name}' is {period:g} s, which does not divide {duration:g} s; choose another "
            "controller"
        )
    return ticks
