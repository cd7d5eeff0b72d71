"""A log that is read, a link that carries the protocol, a search that finds a minimum, a header that is written."""

import socket
import struct
import threading
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import DeviceLost, LinkError, RunError
from dpr_lab.search import ALGORITHMS
from dpr_lab.storage.readers import read_any
from dpr_lab.transports import open_transport


def test_a_log_is_read_and_a_damaged_one_refused(tmp_path: Path) -> None:
    rows = np.column_stack([np.arange(5) * 0.01, np.linspace(3, 1, 5), np.linspace(0, 1, 5)]).astype("<f4")
    names = b"".join(struct.pack("8s", name) for name in (b"t", b"theta1", b"theta2"))
    file = tmp_path / "swing.log"
    file.write_bytes(b"BENCH1\x03" + names + rows.tobytes())
    table = read_any(file)
    assert table.names == ("t", "theta1", "theta2")
    assert np.allclose(np.column_stack(table.values), rows)
    file.write_bytes(file.read_bytes()[:-3])
    with pytest.raises(RunError, match="damaged"):
        read_any(file)


def test_a_link_carries_bytes_and_names_its_loss(tmp_path: Path) -> None:
    path = tmp_path / "rig.sock"
    with pytest.raises(LinkError, match="no connection"):
        open_transport(f"unix://{path}")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen(1)
        threading.Thread(target=lambda: server.accept()[0].close(), daemon=True).start()
        link = open_transport(f"unix://{path}")
        with pytest.raises(DeviceLost):
            link.receive(60.0)
        link.close()


def test_the_search_finds_the_minimum_of_a_bowl() -> None:
    random = ALGORITHMS["random"]
    box = np.array([[-1.0, -1.0], [1.0, 1.0]])
    settings = random.settings(algorithm="random")
    last = list(random.run(lambda x: np.sum(x**2, axis=1)[:, None], box, settings, np.random.default_rng(1)))[-1]
    assert last.evaluations == 51 * 100
    assert last.best_cost < 1e-2
