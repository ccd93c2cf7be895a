"""The action tables of config/actions, which the project's own code is built with."""

import struct
import tomllib
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "config/actions"


def digest(actions):
    """A table's id: FNV-1a, 64 bits, of names and motions, as `guidance::ActionTable::id` has it."""
    value = 0xCBF29CE484222325
    for action in actions:
        motion = action["motion"]
        numbers = struct.pack("<3d", motion["x_m"], motion["y_m"], motion["yaw_rad"])
        for byte in action["name"].encode() + numbers:
            value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def load(path):
    """A table's id and actions; ends where its id is not that of its actions."""
    table = tomllib.loads(path.read_text())
    found = digest(table["actions"])
    if table["id"] != f"{found:#018x}":
        raise SystemExit(f'{path} says id = "{table["id"]}", and its actions have "{found:#018x}"')
    return found, table["actions"]


def name_of(table_id, folder=FOLDER):
    """What a manifest calls the table of that id."""
    for path in sorted(folder.glob("*.toml")):
        if load(path)[0] == table_id:
            return path.stem
    raise SystemExit(f"no table in {folder} has the id {table_id:#018x}")
