"""The connection to a robot over DDS, the middleware of Unitree's robots."""

import contextlib
import importlib
import socket
import time
from collections.abc import Iterator
from typing import Any

from hugwbc.deploy.transport import HISTORY, UNREACHABLE, Service
from hugwbc.deploy.wire import COMMAND, STATE, from_cdr, idl_class, text_of, to_cdr
from hugwbc.errors import ConfigError, needing, one_line

TOPICS = {COMMAND: "rt/lowcmd", STATE: "rt/lowstate"}
_SWITCHER = {"rt/api/motion_switcher/request": "Request_", "rt/api/motion_switcher/response": "Response_"}
LOOPBACK = "lo"
LAST_DOMAIN = 232  # of the ports that RTPS assigns to domains
# On loopback, two programs of ours find each other at the first ports of this machine, since not every machine has
# multicast there. Where there is, it is used to find others, such as the maker's programs, which rely on it.
_LOOPBACK = """<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="{net}"/></Interfaces>
<AllowMulticast>spdp</AllowMulticast></General><Discovery><Peers><Peer address="127.0.0.1"/></Peers>
<ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>"""
_NETWORK = """<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="{net}"/></Interfaces></General>
</Domain></CycloneDDS>"""
_CALL_AGAIN = 0.5  # [s] after which a call is repeated
_MOST_WRITERS = 1000  # of a network
_BUSY_PAUSE = 0.002  # [s] between two looks for an answer
_TEXT = "std_msgs.String_"


class _Raw:
    """A message that stays bytes; readers and writers of cyclonedds call these methods of a topic's data type."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None

    def serialize(self, use_version_2: bool | None = None) -> bytes:
        """Return the bytes; the two versions of CDR do not differ in these messages."""
        return self.data

    @classmethod
    def deserialize(cls, data: bytes) -> "_Raw":
        """Keep the bytes."""
        return cls(data)

    deserialize_key = deserialize


class DdsEndpoint:
    """One end of a connection over DDS."""

    def __init__(self, *, package: str, robot: bool, net: str, domain: int) -> None:
        """Join the network.

        Args:
            package: IDL package of the robot's messages.
            robot: whether this is the robot's end, which sends states, or the other one, which sends commands.
            net: network interface, such as "lo" or "eth0".
            domain: DDS domain; 0 on a robot, 1 for simulated ones by the maker's custom.
        """
        check_network(net, domain)
        self._robot, self._dds = robot, _cyclonedds()
        core, policy, qos = self._dds.core, self._dds.qos.Policy, self._dds.qos.Qos
        kinds = (STATE, COMMAND) if robot else (COMMAND, STATE)
        self._sends, self._receives = (f"{package}.{kind}" for kind in kinds)
        configuration = (_LOOPBACK if net == LOOPBACK else _NETWORK).format(net=net)
        try:
            self._domain = self._dds.domain.Domain(domain, configuration)
            self._participant = self._dds.domain.DomainParticipant(domain)
        except core.DDSException as error:
            raise ConfigError(
                f"DDS cannot use network {net} in domain {domain}: {error}; check the interface's address, and that "
                "this process has not joined the domain before"
            ) from error
        best_effort = qos(policy.Reliability.BestEffort, policy.History.KeepLast(HISTORY))
        # Texts are few, and each one counts: that a hand lets go is said once.
        self._reliable = qos(policy.Reliability.Reliable(0), policy.History.KeepLast(HISTORY))
        self._text_writers: dict[str, Any] = {}
        self._text_readers: dict[str, Any] = {}
        self._writer = self._dds.pub.DataWriter(self._participant, self._raw_topic(self._sends))
        self._reader = self._dds.sub.DataReader(self._participant, self._raw_topic(self._receives), qos=best_effort)
        states = core.ViewState.Any | core.InstanceState.Any | core.SampleState.NotRead
        unread = core.ReadCondition(self._reader, states)
        self._wait = core.WaitSet(self._participant)
        self._wait.attach(unread)
        self._condition, self._error, self._receiving = unread, core.DDSException, True
        self._rivals: Any = None  # a reader of what others send in this end's place
        self._service: Service | None = None
        self._calls: tuple[Any, Any] | None = None
        self._call_count = 0

    def _topic(self, name: str, kind: str) -> Any:  # noqa: ANN401  a topic of cyclonedds
        return self._dds.topic.Topic(self._participant, name, idl_class(kind))

    def _raw_topic(self, kind: str, name: str | None = None) -> Any:  # noqa: ANN401  a topic of cyclonedds
        """Return a topic, by default that of a message, with its type on the network and bytes in this process.

        Where a text is not UTF-8, cyclonedds would raise an error and lose all messages that wait.
        """
        topic = self._topic(name or TOPICS[kind.partition(".")[2]], kind)
        topic.data_type = _Raw
        return topic

    def send(self, message: bytes) -> None:
        """Send a message; network errors are silent, like lost messages."""
        with contextlib.suppress(self._error):
            self._writer.write(_Raw(to_cdr(self._sends, message)))

    def receive(self, timeout: float) -> list[bytes]:
        """Return the messages that have arrived, oldest first; wait up to `timeout` [s] for the first one."""
        self._answer()
        with contextlib.suppress(self._error):
            samples = self._reader.take(N=HISTORY)
            if not samples and timeout > 0.0:
                self._wait.wait(self._dds.util.duration(seconds=timeout))
                samples = self._reader.take(N=HISTORY)
            data = [sample.data for sample in samples if isinstance(sample, _Raw)]
            return [from_cdr(self._receives, one) or one for one in data]  # what is no message is refused later
        return []

    def foreign(self) -> str | None:
        """Return the kind of messages that others send to this end but it does not read; None if there are none."""
        topic, builtin = TOPICS[self._receives.partition(".")[2]], self._dds.builtin
        reader = builtin.BuiltinDataReader(self._participant, builtin.BuiltinTopicDcpsPublication)
        found = reader.read(N=_MOST_WRITERS)
        writers = (writer for writer in found if getattr(writer, "topic_name", "") == topic)
        kinds = {one_line(writer.type_name.replace("::msg::dds_::", ".")) for writer in writers}
        return next(iter(kinds - {self._receives}), None)

    def rivals(self) -> int:
        """Return how many messages others have sent in this end's place; see `Endpoint.rivals`."""
        if self._rivals is None:
            policy, qos = self._dds.qos.Policy, self._dds.qos.Qos
            others = qos(policy.Reliability.BestEffort, policy.History.KeepLast(1), policy.IgnoreLocal.Participant)
            self._rivals = self._dds.sub.DataReader(self._participant, self._raw_topic(self._sends), qos=others)
        with contextlib.suppress(self._error):
            return sum(isinstance(sample, _Raw) for sample in self._rivals.take(N=HISTORY))
        return 0

    def stop_receiving(self) -> None:
        """Leave the states and the rivals to another process of this end."""
        # An entity of cyclonedds is deleted with its last reference; whatever depends on another one goes first.
        self._wait.detach(self._condition)
        del self._condition, self._wait
        del self._reader, self._rivals
        self._receiving = False

    def publish(self, topic: str, text: str) -> None:
        """Send a text on a topic besides states and commands."""
        if topic not in self._text_writers:
            writer = self._dds.pub.DataWriter(self._participant, self._topic(topic, _TEXT), qos=self._reliable)
            self._text_writers[topic] = writer
        with contextlib.suppress(self._error):
            self._text_writers[topic].write(idl_class(_TEXT)(text))

    def texts(self, topic: str) -> list[str]:
        """Return the texts that have arrived on a topic since the last call, oldest first.

        The first call subscribes.
        """
        if topic not in self._text_readers:
            reader = self._dds.sub.DataReader(self._participant, self._raw_topic(_TEXT, topic), qos=self._reliable)
            self._text_readers[topic] = reader
        with contextlib.suppress(self._error):
            samples = self._text_readers[topic].take(N=HISTORY)
            return [text_of(sample.data) for sample in samples if isinstance(sample, _Raw)]
        return []

    def call(self, number: int, parameter: str, timeout: float) -> tuple[int, str]:
        """Call the robot's motion switcher and wait for the answer; see `Endpoint.call`."""
        writer, reader = self._switcher()
        end = time.perf_counter() + timeout
        self._call_count += 1
        identity = time.time_ns() + self._call_count
        header = _api("RequestHeader_")(
            _api("RequestIdentity_")(identity, number), _api("RequestLease_")(0), _api("RequestPolicy_")(0, False)
        )
        request = _api("Request_")(header, parameter, [])
        again = 0.0
        while (now := time.perf_counter()) < end:
            if now >= again:  # an answer is lost while the other side has not yet found this one's reader
                writer.write(request)
                again = now + _CALL_AGAIN
            for answer in _heard(reader, "Response_"):
                if answer.header.identity.id == identity:
                    return answer.header.status.code, answer.data
            time.sleep(_BUSY_PAUSE)
        return UNREACHABLE, ""

    def serve(self, service: Service) -> None:
        """Answer calls of the motion switcher from now on."""
        self._service = service
        self._switcher()

    def _answer(self) -> None:
        if self._service is None:
            return
        writer, reader = self._switcher()
        for request in _heard(reader, "Request_"):
            code, data = self._service(request.header.identity.api_id, request.parameter)
            header = _api("ResponseHeader_")(request.header.identity, _api("ResponseStatus_")(code))
            writer.write(_api("Response_")(header, data, []))

    def _switcher(self) -> tuple[Any, Any]:
        """Return writer and reader of calls and answers, made when they are first needed."""
        if self._calls is None:
            topics = [self._topic(name, f"unitree_api.{kind}") for name, kind in _SWITCHER.items()]
            written, read = reversed(topics) if self._robot else topics
            read.data_type = _Raw
            writer, reader = self._dds.pub.DataWriter, self._dds.sub.DataReader
            self._calls = writer(self._participant, written), reader(self._participant, read)
        return self._calls

    def close(self) -> None:
        """Leave the network."""
        if self._receiving:
            self.stop_receiving()
        self._calls = None
        self._text_writers.clear()
        self._text_readers.clear()
        del self._writer
        del self._participant, self._domain


def _api(name: str) -> Any:  # noqa: ANN401  a class of cyclonedds
    return idl_class(f"unitree_api.{name}")


def _heard(reader: Any, name: str) -> Iterator[Any]:  # noqa: ANN401  of cyclonedds
    """Yield the calls or answers that have arrived; one whose text is not UTF-8 is left out."""
    for sample in reader.take(N=HISTORY):
        if isinstance(sample, _Raw):
            with contextlib.suppress(UnicodeDecodeError):
                yield _api(name).deserialize(sample.data)


def check_network(net: str, domain: int) -> None:
    """Check that a network interface and a DDS domain exist."""
    names = [name for _, name in socket.if_nameindex()]
    if net not in names:
        raise ConfigError(f"there is no network interface '{net}'; this machine has {', '.join(names)}")
    if not 0 <= domain <= LAST_DOMAIN:
        raise ConfigError(f"DDS domain is {domain}; give 0 (a robot) to {LAST_DOMAIN}")


def _cyclonedds() -> Any:  # noqa: ANN401  an optional package
    """Return the package with its modules that are used here."""
    with needing("deploy", "a connection to a robot"):
        for name in ("builtin", "core", "domain", "pub", "qos", "sub", "topic", "util"):
            importlib.import_module(f"cyclonedds.{name}")
        return importlib.import_module("cyclonedds")
