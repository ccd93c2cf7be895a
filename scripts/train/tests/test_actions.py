"""The action tables as files (needs neither torch nor the environment)."""

import pytest

from actions import FOLDER, load, name_of

# As in shared/guidance/src/action.rs: policies, permits and recordings hold these ids.
EIGHT, NINE, TEN = 0x8D8249FA0FB72E14, 0x4B90C66CA1B1E168, 0xCCFDC40C3C75FF4B


def test_the_tables_are_what_they_always_were():
    (eight, its_actions), (nine, with_back), (ten, more) = (
        load(FOLDER / f"{name}.toml") for name in ("eight", "nine", "ten")
    )
    assert (eight, nine, ten) == (EIGHT, NINE, TEN)
    assert with_back[:8] == more[:8] == its_actions and (len(with_back), len(more)) == (9, 10)


def test_a_manifest_calls_a_table_by_its_file():
    assert [name_of(table) for table in (EIGHT, NINE, TEN)] == ["eight", "nine", "ten"]
    with pytest.raises(SystemExit, match="has the id 0x0000000000000001"):
        name_of(1)


@pytest.mark.parametrize("was, becomes", [("x_m = 0.25", "x_m = 0.26"), ('"sidestep_left"', '"sidestep"')])
def test_a_table_whose_actions_are_not_those_of_its_id_is_refused(tmp_path, was, becomes):
    text = (FOLDER / "eight.toml").read_text()
    assert was in text
    (tmp_path / "eight.toml").write_text(text.replace(was, becomes))
    with pytest.raises(SystemExit, match='says id = "0x8d8249fa0fb72e14", and its actions have'):
        name_of(EIGHT, tmp_path)
