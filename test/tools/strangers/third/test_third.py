# SPDX-License-Identifier: Apache-2.0
"""The systems of MuJoCo are in the third set where it can be imported."""

from .bodies import AVAILABLE
from .recordings import TABLE
from .systems import MUJOCO, SYSTEMS

#: Names of the systems that MuJoCo simulates.
BODIES = {system.name for system in MUJOCO}


def test_systems_of_mujoco_are_in_the_set_where_it_can_be_imported() -> None:
    assert {recording.system for recording in TABLE} == {*SYSTEMS} | BODIES
    assert BODIES & {*SYSTEMS} == (BODIES if AVAILABLE else set())
