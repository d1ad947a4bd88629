"""The publisher and its watchdogs, each in 20 trials, and the threads."""

import multiprocessing
import pickle
import threading
import time

import numpy as np
import pytest
from deploy_bench import Counting, Standing, bring_to, make_pilot
from local_endpoint import local_pair

from hugwbc import load_robot, rotations
from hugwbc.deploy import robot_side, wire
from hugwbc.deploy.capture import GRIPS
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.pilot import Pilot
from hugwbc.deploy.relay import DECISION, PERIOD, Relay, Settings
from hugwbc.deploy.remote import Remote, Request
from hugwbc.deploy.robot_side import RobotSide
from hugwbc.deploy.state_machine import DAMPING_GAIN, Mode
from hugwbc.errors import DeploymentError

H1 = load_robot()
TRIALS = 20
SLOT = 0.002


def is_damping(message: bytes | None) -> bool:
    """Whether a sealed message damps all joints; it must hold them stiffly otherwise."""
    assert message is not None and wire.is_sealed(message)
    command = Messages(H1).unpack_command(message).command
    damping = bool(np.all(command.kd == DAMPING_GAIN) and not np.any(command.kp))
    assert damping or np.all(command.kp == H1.kp.astype(np.float32))
    return damping


class Bench:
    """A robot side whose time is told, fed with the states of a standing robot until its controller runs."""

    def __init__(
        self, standing: Standing, controller: Counting | None = None, publishing: float = 0.5, **settings
    ) -> None:
        """Take what stands, what controls it, and the share of a slot after which a command is published."""
        self.robot_end, end = local_pair()
        self.standing, self.publishing = standing, publishing
        self.told: list[str] = []
        self.controller = controller or Counting()
        self.pilot = make_pilot(self.controller)
        self.side = RobotSide(self.pilot, H1, end, Settings(**settings), tell=self.told.append)
        bring_to(Mode.RUN, self.pilot, standing)
        self.now = 100.0
        self.slot()

    def slot(self, raw: bytes | None = None, *, silent: bool = False, answer: bool = True) -> bytes | None:
        """Pass 2 ms: a state arrives unless it is silent, is answered, and a command is published."""
        self.now += SLOT
        if not silent:
            data = self.standing.raw() if raw is None else raw
            state = self.side.accept(data, self.now)
            if state is not None and answer:
                self.side.handle(data, state, self.now)
        self.side.publish(self.now + self.publishing * SLOT)
        sent = self.robot_end.receive(0.0)
        return sent[-1] if sent else None

    def until_damping(self, **slot) -> float:
        """Time until damping is published, with the same kind of slot all along [s]."""
        for count in range(1, 80):
            if is_damping(self.slot(**slot)):
                return count * SLOT
        raise AssertionError("no damping within 160 ms")


def at_a_random_moment(still, trial: int) -> Bench:
    """Return a bench after some sound slots, which publishes at another moment of a slot in each trial."""
    rng = np.random.default_rng(trial)
    bench = Bench(Standing(still, Messages(H1)), publishing=rng.uniform())
    for _ in range(rng.integers(1, 12)):
        assert not is_damping(bench.slot())
    return bench


def faulty_slot(fault: str, bench: Bench, trial: int) -> dict:
    """What each slot is like from now on."""
    if fault == "old tick":
        old = bench.standing.raw()
        bench.slot()
        return {"raw": old}
    if fault == "wrong check sum":
        wrong = bytearray(bench.standing.raw())
        wrong[int(np.random.default_rng(trial).integers(len(wrong)))] ^= 0x10
        return {"raw": bytes(wrong)}
    return {"silent": True} if fault == "no state for" else {"answer": False}


@pytest.mark.parametrize("trial", range(TRIALS))
@pytest.mark.parametrize("fault", ["no state for", "old tick", "wrong check sum", "controller is"])
def test_faults_of_connection_and_controller_damp_within_their_time(still, fault, trial) -> None:
    bench = at_a_random_moment(still, trial)
    slot = faulty_slot(fault, bench, trial)
    assert 0.1 <= bench.until_damping(**slot) <= 0.1 + 2 * SLOT
    assert fault in bench.told[0]


@pytest.mark.parametrize("trial", range(TRIALS))
def test_limits_of_the_body_damp_within_their_time(still, trial) -> None:
    rng, bench = np.random.default_rng(trial), at_a_random_moment(still, trial)
    fast = np.zeros(19)
    fast[rng.integers(19)] = 60.0
    fault = [
        {"orientation": rotations.from_yaw_pitch_roll(rng.uniform(-3, 3), rng.choice((-1.1, 1.1)), 0.0)},
        {"dq": fast},
        {"hot": 90.0},
    ][trial % 3]
    for count in range(1, 10):
        if is_damping(bench.slot(bench.standing.raw(**fault))):
            assert count * SLOT <= 0.006 + SLOT
            return
    raise AssertionError("no damping")


def test_damping_stays_when_states_come_back(standing) -> None:
    bench = Bench(standing)
    bench.until_damping(silent=True)
    for _ in range(20):
        assert is_damping(bench.slot())
    assert bench.pilot.mode is Mode.DAMPING and bench.pilot.machine.faulty
    assert "no state for" in bench.pilot.machine.events[-1].reason


def test_a_command_is_held_while_the_next_one_is_late(standing) -> None:
    bench = Bench(standing)
    last = bench.slot()
    for _ in range(8):
        assert bench.slot(answer=False) == last
    assert bench.side.timing.missed == 0
    assert not is_damping(bench.slot())


def test_missed_deadlines_are_counted(standing) -> None:
    bench = Bench(standing)
    before = bench.side.timing.missed
    raw = standing.raw()
    state = bench.side.accept(raw, bench.now)
    bench.now += 0.008
    assert state is not None
    bench.side.handle(raw, state, bench.now)
    bench.side.publish(bench.now)
    assert bench.side.timing.missed == before + 1


def test_a_dry_run_sends_nothing(standing) -> None:
    bench = Bench(standing, dry_run=True)
    assert [bench.slot() for _ in range(5)] == [None] * 5
    assert bench.controller.calls >= 5 and bench.side.timing.latency.count >= 4


def test_a_dry_run_answers_nothing_in_lockstep_asks_for_no_grip_and_damps_nothing(standing, monkeypatch) -> None:
    monkeypatch.setattr(Pilot, "grips", ("box", None))
    robot_end, end = local_pair()
    pilot = make_pilot()
    bring_to(Mode.RUN, pilot, standing)
    side = RobotSide(pilot, H1, end, Settings(lockstep=True, dry_run=True), tell=lambda line: None)
    robot_end.send(standing.raw())
    assert side.answer(0.0) and side._message is not None
    side._damp()
    assert robot_end.receive(0.0) == [] and robot_end.texts(GRIPS) == [] and side.sent == 0


def test_a_duration_ends_in_damping_and_then_the_program(standing, monkeypatch) -> None:
    monkeypatch.setattr(robot_side, "FADE", 0.05)
    bench = Bench(standing, duration=0.1)
    sent = [bench.slot() for _ in range(46)]
    assert not any(map(is_damping, sent)) and bench.pilot.mode is Mode.RUN
    for _ in range(6):
        bench.slot()
    assert bench.pilot.mode is Mode.DAMPING and bench.pilot.machine.events[-1].reason == "asked to stop"
    assert is_damping(bench.slot()) and not bench.side._end.is_set()
    for _ in range(25):
        assert is_damping(bench.slot())
    assert bench.side._end.is_set() and bench.side.fault is None


def test_a_duration_is_also_kept_by_the_wall_clock_where_the_robot_is_silent() -> None:
    _, end = local_pair()
    side = RobotSide(make_pilot(), H1, end, Settings(duration=3.0, slower=2.0))
    left = side._deadline() - time.perf_counter()
    assert left == pytest.approx(2.0 * (3.0 + robot_side.FADE + robot_side._PATIENCE), abs=0.5)
    assert RobotSide(make_pilot(), H1, end)._deadline() == np.inf


def test_a_first_stop_damps_and_a_second_one_ends(standing, monkeypatch) -> None:
    monkeypatch.setattr(robot_side, "FADE", 0.3)
    bench = Bench(standing)
    bench.side.ask(Request.STOP)
    assert is_damping(bench.slot()) and not bench.side._end.is_set()
    bench.side.ask(Request.STOP)
    asked = time.perf_counter()
    assert not bench.side._end.is_set(), "the robot may yet fall"
    assert bench.side._end.wait(10.0) and time.perf_counter() - asked > 0.29


def test_what_a_relay_in_another_process_needs_gets_there() -> None:
    setup = RobotSide(make_pilot(), H1, local_pair()[1], Settings(duration=3.0))._setup
    there = pickle.loads(pickle.dumps(setup))
    assert there.robot.name == "h1" and (there.limits, there.settings) == (setup.limits, setup.settings)


def test_limp_joints_need_no_watchdog(standing) -> None:
    robot_end, end = local_pair()
    side = RobotSide(make_pilot(), H1, end)
    raw = standing.raw()
    side.handle(raw, side.accept(raw, 1.0), 1.0)  # type: ignore[arg-type]
    side.publish(2.0)
    (message,) = robot_end.receive(0.0)
    assert not np.any(Messages(H1).unpack_command(message).command.kd) and side.fault is None


class Feeder:
    """The robot's end: it sends standing states in real time, from a thread, and keeps what it receives."""

    def __init__(self, standing: Standing, end, slower: float) -> None:
        self.standing, self.end, self.pause = standing, end, SLOT * slower
        self.messages: list[bytes] = []
        self.remote = Remote()
        self.silent = threading.Event()
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        slot = time.perf_counter()
        while not self.over.is_set():
            if not self.silent.is_set():
                self.end.send(self.standing.raw(self.remote))
            self.messages += self.end.receive(0.0)
            slot = max(slot + self.pause, time.perf_counter() - self.pause)
            time.sleep(max(slot - time.perf_counter(), 0.0))


def run_threads(standing: Standing, controller: Counting, meanwhile) -> tuple[RobotSide, Feeder]:
    """Run a side in its threads, ten times slower than real time for a busy machine."""
    slower = 10.0
    robot_end, end = local_pair()
    pilot = make_pilot(controller)
    bring_to(Mode.RUN, pilot, standing)
    side = RobotSide(pilot, H1, end, Settings(slower=slower))
    feeder = Feeder(standing, robot_end, slower)
    worker = threading.Thread(target=side.run)
    feeder.thread.start()
    worker.start()
    try:
        meanwhile(side, feeder)
    finally:
        side.ask(Request.STOP)
        side._end.set()
        worker.join(10.0)
        feeder.over.set()
        feeder.thread.join(10.0)
    assert not worker.is_alive()
    return side, feeder


def wait_for(condition, seconds: float = 20.0) -> None:
    end = time.perf_counter() + seconds
    while not condition():
        assert time.perf_counter() < end, "took too long"
        time.sleep(0.01)


def test_three_threads_answer_states_and_publish(standing) -> None:
    controller = Counting()
    side, feeder = run_threads(standing, controller, lambda _, feeder: wait_for(lambda: len(feeder.messages) > 40))
    assert controller.calls > 10 and side.sent > 40
    assert all(map(wire.is_sealed, feeder.messages))
    assert side.timing.latency.count > 10 and side.timing.jitter.count > 40
    assert side.timing.jitter.median < PERIOD * 1e3


def test_a_controller_that_hangs_is_damped_by_the_publisher(standing) -> None:
    controller = Counting()
    hang = threading.Event()

    def meanwhile(side: RobotSide, feeder: Feeder) -> None:
        wait_for(lambda: len(feeder.messages) > 5)
        controller.think = lambda: hang.wait(30.0)  # type: ignore[assignment]
        wait_for(lambda: is_damping(feeder.messages[-1]))
        hang.set()

    side, feeder = run_threads(standing, controller, meanwhile)
    assert "late" in str(side.fault)
    command = Messages(H1).unpack_command(feeder.messages[-1]).command
    assert np.all(command.kd == DAMPING_GAIN)


def test_joints_are_damped_when_the_process_that_controls_is_killed(standing, monkeypatch) -> None:
    monkeypatch.setattr("hugwbc.deploy.relay.FADE", 0.2)  # ten times slower
    bench = Bench(standing, slower=10.0)
    robot_end, end = local_pair()
    link, far = multiprocessing.Pipe()
    relay = Relay(end, bench.side._setup, far, records=False)
    feeder, worker = Feeder(standing, robot_end, 10.0), threading.Thread(target=relay.run, daemon=True)
    stiff = bench.slot()
    assert stiff is not None and not is_damping(stiff)
    feeder.thread.start()
    worker.start()
    link.send_bytes(DECISION.pack(1e9, True, True, 0) + stiff)  # answers all states to come
    wait_for(lambda: len(feeder.messages) > 5)
    assert not is_damping(feeder.messages[-1])
    link.close()
    wait_for(lambda: is_damping(feeder.messages[-1]))
    feeder.over.set()
    worker.join(30.0)
    assert not worker.is_alive() and relay.fault == "the controller's process has ended"


def test_a_defect_ends_the_deployment_with_its_error(standing) -> None:
    robot_end, end = local_pair()
    side = RobotSide(make_pilot(), H1, end, Settings(slower=1.0))
    side.pilot.observe = lambda *_, **__: 1 / 0  # type: ignore[method-assign,assignment]
    robot_end.send(standing.raw())
    begin = time.perf_counter()
    with pytest.raises(ZeroDivisionError):
        side.run()
    assert time.perf_counter() - begin < 8.0


def test_a_robot_that_is_slower_than_its_clock_is_damped_at_the_end(standing, monkeypatch) -> None:
    monkeypatch.setattr(robot_side, "FADE", 0.5)
    robot_end, end = local_pair()
    pilot = make_pilot()
    bring_to(Mode.RUN, pilot, standing)
    side = RobotSide(pilot, H1, end, Settings(duration=100.0))
    monkeypatch.setattr(side, "_deadline", lambda: time.perf_counter() + 0.5)
    feeder = Feeder(standing, robot_end, 2.5)
    feeder.thread.start()
    side.run()
    feeder.over.set()
    feeder.thread.join(10.0)
    command = Messages(H1).unpack_command(feeder.messages[-1]).command
    assert pilot.mode is Mode.DAMPING and np.all(command.kd == DAMPING_GAIN)
    assert side.fault is None and pilot.machine.events[-1].reason == "asked to stop"


def test_a_second_ctrl_c_neither_cuts_the_damping_short_nor_loses_the_figures(standing, monkeypatch) -> None:
    monkeypatch.setattr(robot_side, "FADE", 0.5)
    robot_end, end = local_pair()
    pilot = make_pilot()
    bring_to(Mode.RUN, pilot, standing)
    side = RobotSide(pilot, H1, end)
    pressed = iter([0.5, 0.1])

    class Interrupted(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            if (after := next(pressed, None)) is None:
                return super().wait(timeout)
            time.sleep(after)
            raise KeyboardInterrupt

    side._end = Interrupted()
    feeder = Feeder(standing, robot_end, 2.5)
    feeder.thread.start()
    begin = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        side.run()
    feeder.over.set()
    feeder.thread.join(10.0)
    assert time.perf_counter() - begin > 1.0 and pilot.mode is Mode.DAMPING and is_damping(feeder.messages[-1])
    assert side.sent > 0 and side.fault is None and pilot.machine.events[-1].reason == "asked to stop"


def test_a_second_program_is_told_and_damps_a_driven_robot(standing) -> None:
    bench = Bench(standing)
    bench.side.look_out()
    assert not is_damping(bench.slot()) and bench.told == []
    bench.side._endpoint.heard_rivals = 1  # type: ignore[attr-defined]
    bench.side.look_out()
    assert is_damping(bench.slot())
    bench.slot()
    assert any("another program commands this robot" in line for line in bench.told)
    assert "another program" in bench.pilot.machine.events[-1].reason


def test_a_second_program_is_told_while_the_joints_are_limp_and_keeps_them_so() -> None:
    _, end = local_pair()
    told: list[str] = []
    side = RobotSide(make_pilot(), H1, end, tell=told.append)
    for _ in range(3):
        end.heard_rivals = 1
        side.look_out()
    assert len(told) == 1 and "another program" in told[0] and side.fault is None


def test_a_relay_that_is_killed_is_told_at_once_and_this_process_damps(standing, monkeypatch) -> None:
    monkeypatch.setattr(robot_side, "FADE", 0.2)
    bench = Bench(standing)
    bench.robot_end.receive(0.0)
    bench.side._far.close()
    tell, sent_before = bench.side._tell, list[int]()
    bench.side._tell = lambda line: (tell(line), sent_before.append(len(bench.robot_end.receive(0.0))))  # type: ignore
    bench.side._control()
    assert sent_before[0] == 0, "it waits for nothing"
    assert "process that reads and publishes has ended: damping" in bench.told[0]
    sent = bench.robot_end.receive(0.0)
    assert len(sent) > 20 and all(map(is_damping, sent))
    assert "gets no commands" in str(bench.side._failure) and bench.side._end.is_set()


def test_in_lockstep_a_robot_whose_states_are_all_refused_is_damped(standing) -> None:
    """A robot that is restarted counts from 1 again: its states look old, and are no reason to go on as before."""
    robot_end, end = local_pair()
    pilot, told = make_pilot(), []
    bring_to(Mode.RUN, pilot, standing)
    side = RobotSide(pilot, H1, end, Settings(lockstep=True), tell=told.append)

    def answered(raw: bytes) -> bool:
        robot_end.send(raw)
        assert side.answer(0.0)
        return is_damping(robot_end.receive(0.0)[-1])

    assert not any(answered(standing.raw()) for _ in range(5))
    standing.tick = 1
    damped = [answered(standing.raw()) for _ in range(600)]
    assert not any(damped[:49]) and all(damped[51:])
    assert any(line.startswith("watchdog: no state for 10") and "with an old tick: damping" in line for line in told)
    assert pilot.mode is Mode.DAMPING and side.intake.old < 510, "after a second, its states are believed again"


@pytest.mark.parametrize("mode", [Mode.RUN, Mode.DAMPING])
def test_a_robot_that_is_gone_in_lockstep_is_told_and_fails_a_run(standing, monkeypatch, mode) -> None:
    monkeypatch.setattr(robot_side, "_PATIENCE", 0.1)
    monkeypatch.setattr(robot_side, "POLL", 0.02)
    robot_end, end = local_pair()
    pilot, told = make_pilot(), []
    bring_to(mode, pilot, standing)
    side = RobotSide(pilot, H1, end, Settings(lockstep=True), tell=told.append)
    robot_end.send(standing.raw())  # its last word
    if mode is Mode.RUN:
        with pytest.raises(DeploymentError, match=r"sent nothing for 0\.1 s, and was in the mode run; let"):
            side.run()
    else:
        side.run()
        assert told == ["the robot has sent nothing for 0.1 s: the end"]
