"""The wayfinding task of Kim et al. 2023 for Gymnasium: worlds, sensors, shield, observation and reward are guidedog's own."""

import gymnasium

from guidedog_environment._native import (
    ACTION_TABLE_ID, ACTIONS, CHANNELS, LENGTH, OBSERVATION, SECTORS, STATE, Episodes,
)
from guidedog_environment.environments import Wayfinding, WayfindingVector

__all__ = [
    "ACTION_TABLE_ID", "ACTIONS", "CHANNELS", "LENGTH", "OBSERVATION", "SECTORS", "STATE", "Episodes", "Wayfinding",
    "WayfindingVector",
]

gymnasium.register(
    id="guidedog/Wayfinding-v0",
    entry_point="guidedog_environment:Wayfinding",
    vector_entry_point="guidedog_environment:WayfindingVector",
)
