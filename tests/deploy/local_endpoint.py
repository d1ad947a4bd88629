"""Both ends of a connection between a robot and its robot side, within one process."""

import collections
import threading

from hugwbc.deploy.transport import HISTORY, UNREACHABLE, Service


class LocalEndpoint:
    """An end that keeps the newest few messages for the other one, as a reader of the network does."""

    def __init__(self) -> None:
        self.other = self
        self._changed = threading.Condition()
        self._messages: collections.deque[bytes] = collections.deque(maxlen=HISTORY)
        self._texts = collections.defaultdict(lambda: collections.deque[str](maxlen=HISTORY))
        self._service: Service | None = None
        self.heard_rivals = 0

    def send(self, message: bytes) -> None:
        with self.other._changed:
            self.other._messages.append(message)
            self.other._changed.notify()

    def receive(self, timeout: float) -> list[bytes]:
        with self._changed:
            self._changed.wait_for(lambda: self._messages, timeout)
            messages = list(self._messages)
            self._messages.clear()
        return messages

    def rivals(self) -> int:
        heard, self.heard_rivals = self.heard_rivals, 0
        return heard

    def stop_receiving(self) -> None:
        pass

    def publish(self, topic: str, text: str) -> None:
        self.other._texts[topic].append(text)

    def texts(self, topic: str) -> list[str]:
        waiting = self._texts[topic]
        return [waiting.popleft() for _ in range(len(waiting))]

    def call(self, number: int, parameter: str, timeout: float) -> tuple[int, str]:
        service = self.other._service
        return (UNREACHABLE, "") if service is None else service(number, parameter)

    def serve(self, service: Service) -> None:
        self._service = service

    def close(self) -> None:
        pass


def local_pair() -> tuple[LocalEndpoint, LocalEndpoint]:
    """Return the robot's end and the other end."""
    robot, other = LocalEndpoint(), LocalEndpoint()
    robot.other, other.other = other, robot
    return robot, other
