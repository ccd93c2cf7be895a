"""The environment as Gymnasium wants it, and as the project's own code is."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import guidedog_environment
from actions import FOLDER, load
from guidedog_environment import ACTION_TABLE_ID, ACTIONS, LENGTH, Episodes, WayfindingVector


def test_gymnasium_finds_nothing_wrong():
    environment = gymnasium.make("guidedog/Wayfinding-v0", noise="ideal")
    check_env(environment.unwrapped, skip_render_check=True)


def test_the_actions_are_those_of_the_table_that_a_manifest_names():
    table_id, actions = load(FOLDER / "eight.toml")
    assert (ACTION_TABLE_ID, ACTIONS) == (table_id, [action["name"] for action in actions])


def test_an_episode_is_cut_short_after_its_decisions_and_told_of():
    environment = gymnasium.make("guidedog/Wayfinding-v0", decisions=7).unwrapped
    environment.reset(seed=3)
    for decision in range(7):
        _, _, terminated, truncated, info = environment.step(0)
        assert not terminated and truncated == (decision == 6)
    assert {"cue", "success", "collisions", "distance_m", "reward"} <= set(info)
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.step(0)


def walk(seed, **options):
    vector = WayfindingVector(5, **options)
    seen, _ = vector.reset(seed=seed)
    trace = [seen["senses"].copy()]
    for decision in range(30):
        seen, rewards, _, _, _ = vector.step(np.full(5, decision % len(ACTIONS)))
        trace += [seen["senses"].copy(), rewards.copy(), seen["unsafe"].copy()]
    return trace


def test_the_same_seed_is_the_same_walk_to_the_bit():
    one, other = walk(1), walk(1)
    assert all(np.array_equal(a, b) for a, b in zip(one, other))
    assert not np.array_equal(one[0], walk(2)[0])


def test_the_vector_hands_out_what_the_last_decision_led_to():
    vector = WayfindingVector(4, decisions=5)
    vector.reset(seed=1)
    ended = 0
    for _ in range(10):
        seen, _, terminated, truncated, infos = vector.step(np.zeros(4, int))
        assert not terminated.any()
        for place in np.flatnonzero(truncated):
            ended += 1
            last = infos["final_obs"][place]
            assert last["senses"].shape == (LENGTH,)
            assert not np.array_equal(last["senses"], seen["senses"][place])
    assert ended >= 4


def test_frames_are_stacked_and_begin_alike():
    seen, _ = WayfindingVector(2, frames=3).reset(seed=1)
    frames = seen["senses"].reshape(2, 3, LENGTH)
    assert np.array_equal(frames[:, 0], frames[:, 2])


def test_the_teacher_gets_there():
    vector = WayfindingVector(16, noise="ideal")
    vector.reset(seed=5)
    reports = []
    for decision in range(230):
        _, _, _, truncated, infos = vector.step(vector.taught().argmax(axis=1))
        # The first ones are cut short, each at another decision.
        whole = np.flatnonzero(truncated) if decision >= 100 else []
        reports += [infos["final_info"]["success"][place] for place in whole]
    assert len(reports) >= 16 and np.mean(reports) > 0.8, reports


def test_what_is_no_option_or_no_action_is_told():
    with pytest.raises(ValueError, match='no option "colour"'):
        Episodes(1, {"colour": 1})
    with pytest.raises(ValueError, match="walked_before = 2 is no share"):
        Episodes(1, {"walked_before": 2.0})
    with pytest.raises(ValueError, match='noise = "loud" is none of'):
        Episodes(1, {"noise": "loud"})
    episodes = Episodes(2, {})
    episodes.begin(1)
    for wrong in ([0], [0, len(ACTIONS)], [0, -1]):
        with pytest.raises(ValueError, match="2 actions from 0 to 7"):
            episodes.step(np.array(wrong))


@pytest.mark.parametrize("key, values, told", [
    ("decisions", (0, -1, 1.5, "7"), "is no whole number of at least 1"),
    ("frames", (0, 17, 2.0, None), "is no whole number from 1 to 16"),
    ("orientation_max_deg", (-1, 181), "is no angle from 0 to 180"),
    ("walked_before", (-0.1, 1.1), "is no share from 0 to 1"),
    ("buildings", (-0.1, 1.1), "is no share from 0 to 1"),
    ("time_penalty", (float("nan"), float("inf"), "much"), "is no finite number"),
    ("memory", (0, 1.0, "no", None), "is neither True nor False"),
    ("maps", ([], "plan.yaml", [1]), "is no list of floor plans"),
    ("noise", (3, None), "is none of"),
])
def test_an_option_out_of_its_bounds_is_told_with_its_value(key, values, told):
    for value in values:
        with pytest.raises(ValueError, match=f"{key} = .*{told}"):
            WayfindingVector(1, **{key: value})


def test_options_at_their_bounds_are_taken():
    for options in ({"decisions": 1, "frames": 16}, {"orientation_max_deg": 180, "walked_before": 1}, {"memory": False}):
        WayfindingVector(1, **options).reset(seed=1)


def test_nothing_is_decided_or_taught_before_the_beginning():
    vector = WayfindingVector(2)
    for act in (vector.taught, lambda: vector.step(np.zeros(2, int))):
        with pytest.raises(ValueError, match="no episode has begun"):
            act()
    with pytest.raises(gymnasium.error.ResetNeeded):
        gymnasium.make("guidedog/Wayfinding-v0").unwrapped.step(0)


def test_actions_are_whole_numbers():
    vector, one = WayfindingVector(2), gymnasium.make("guidedog/Wayfinding-v0").unwrapped
    vector.reset(seed=1), one.reset(seed=1)
    for wrong in (1.0, 1.7, True, "1", float("nan"), 2**70):
        with pytest.raises(TypeError, match="actions are whole numbers"):
            vector.step([wrong, wrong])
        with pytest.raises(TypeError, match="actions are whole numbers"):
            one.step(wrong)
    for wrong in (-1, len(ACTIONS), 2**64 - 1):
        with pytest.raises(ValueError, match="1 actions from 0 to 7"):
            one.step(wrong)


def test_it_is_registered():
    assert guidedog_environment.OBSERVATION
    assert gymnasium.make_vec("guidedog/Wayfinding-v0", num_envs=2, vectorization_mode="vector_entry_point").num_envs == 2
