"""The plugin for pytest: the fixture ``machine``, a simulated machine in virtual time.

    @pytest.mark.machine(slaves="drive*2")
    def test_square(machine):
        machine.at("1 s", "alarm 1 0x7500")
        machine.run("./square")
        machine.axis(1).reached(20000, within="2 s")
"""

from __future__ import annotations

from pathlib import Path
from typing import Iterator

import pytest

from .testing import Machine


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "machine(slaves='drive', **keys): the slaves and keys of the simulated machine (`ecmsk link help`)"
    )


@pytest.fixture
def machine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Machine]:
    """A simulated machine in virtual time. The mark ``machine`` says which slaves it has; one drive without it."""
    mark = request.node.get_closest_marker("machine")
    made = Machine(tmp_path, *(mark.args if mark else ()), **(mark.kwargs if mark else {}))
    try:
        yield made
    finally:
        made._close()
