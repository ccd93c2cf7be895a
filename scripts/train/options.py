"""What the programs here share of reading what they are given: whatever is wrong is told in a line."""

import argparse
import json
import math


def bounded(what, kind, holds):
    """The type of an option that takes such numbers only."""

    def read(text):
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and holds(value)):
            raise argparse.ArgumentTypeError(f"{text} is no {what}")
        return value

    return read


COUNT = bounded("whole number of at least 1", int, lambda value: value >= 1)
# What numpy takes for a seed.
SEED = bounded(f"whole number from 0 to {2**32 - 1}", int, lambda value: 0 <= value < 2**32)
SHARE = bounded("number from 0 to 1", float, lambda value: 0 <= value <= 1)
ABOVE_0 = bounded("number above 0", float, lambda value: value > 0)
AT_LEAST_0 = bounded("number of at least 0", float, lambda value: value >= 0)


def pair(text):
    """KEY=NUMBER, an option of the environment. Counts are whole there, and `memory` is had or not."""
    key, _, number = text.partition("=")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not key or not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not KEY=NUMBER")
    if key == "memory" and value in (0, 1):
        return key, bool(value)
    return key, int(value) if value.is_integer() else value


def pair_text(text):
    """As `arguments.json` keeps it."""
    pair(text)
    return text


def read_json(path):
    """The object that a file holds, or the end, with the reason."""
    try:
        told = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(told, dict):
        raise SystemExit(f"{path} holds no JSON object")
    return told
