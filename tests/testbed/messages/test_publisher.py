"""Published paths: complete to the end, and of a sum that grows with the time driven."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from proving_ground.testbed.messages.publisher import Publisher
from proving_ground.testbed.messages.scenery import Scenery
from proving_ground.testbed.recording.channels import CHANNELS, DRIVEN_TOPIC, STATE

SPEED = 1.1  # m/s


class Listener(Publisher):
    """Keeps times, number of bytes and the last message of the driven path."""

    def __init__(self):
        self.sent, self.last = [], b""
        super().__init__(Scenery(("world",)), CHANNELS)

    def _send(self, topic, times_ns, messages):
        if topic == DRIVEN_TOPIC:
            self.sent += [(1e-9 * time_ns, messages.shape[1]) for time_ns in times_ns.tolist()]
            self.last = messages[-1].tobytes()

    def _collected(self, time_s):
        self._publish(self._take())


def test_the_driven_path_is_complete_and_its_messages_grow_with_the_time():
    listener = Listener()
    for times in np.arange(0.0, 6001.0).reshape(-1, 17):
        states = np.zeros((len(times), len(STATE.fields)))
        states[:, STATE.fields.index("x_t_m")] = SPEED * times
        listener.rows(STATE, times, states)
    times, sizes = np.array(listener.sent).T
    assert np.diff(times[times < 500.0]) == pytest.approx(5.0, abs=0.1)
    assert (np.diff(times) <= np.maximum(5.0, 0.01 * times[1:] + 1.0) + 1e-6).all()
    early, late = (sizes[(times > a) & (times <= b)].sum() for a, b in ((1e3, 2e3), (5e3, 6e3)))
    assert late < 1.3 * early  # a fixed period would make it 3.7 times as much
    x = [pose.position.x for pose in PosesInFrame.FromString(listener.last).poses]
    assert x[-1] == pytest.approx(SPEED * times[-1], abs=2.0)
    assert np.diff(x) == pytest.approx(SPEED, abs=1e-3)
