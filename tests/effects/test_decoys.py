"""Decoys: laws that no machine has. Offered to a diagnosis they stay unnamed; hidden in a campaign they are found and told."""

import json
from functools import partial

import numpy as np
import pytest

from testbed.catalogue import DECOYS, catalogue
from testbed.cli import main
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import fast
from testbed.workshop import write_campaign
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

EVERY = catalogue(DECOYS)
NAMES = sorted(set(EVERY) - set(catalogue()))
CUTS = ((3810, 2.9), (2850, 2.9), (4200, 1.5))
HIDDEN = "decoy_five_fold"


def test_decoys_are_in_no_catalogue_that_does_not_ask_for_them():
    assert len(NAMES) == 4 and all(name.startswith("decoy_") for name in NAMES)
    assert {EVERY[name].path.parent for name in NAMES} == {DECOYS}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.long
def test_a_decoy_is_seen_at_its_example_and_is_nothing_when_neutral(name):
    cut = Cut(3810 * 2 * np.pi / 60, 2e-3, idle_passes=0, passes=20, ring_down_passes=2)
    effect, sampling = EVERY[name], whole_cut_sampling(cut, 1, 12800.0)
    plain, neutral, seen = (fast.simulate(model, cut, sampling, catalogue=EVERY).channels["displacement"] for model in (
        TRUE, TRUE.with_effect(name, **effect.neutral()), TRUE.with_effect(name, **effect.example())))
    np.testing.assert_array_equal(plain, neutral)
    assert 1e-3 < np.abs(seen - plain).max() / np.ptp(plain) < 1.0


@pytest.mark.long
def test_a_decoy_that_is_hidden_is_named_and_the_campaign_not_to_be_trusted(tmp_path, capsys):
    true = TRUE.with_effect(HIDDEN, amplitude=8.0e3)
    simulate = partial(fast.simulate, steps=37, catalogue=EVERY)
    write_campaign(tmp_path, synthetic_campaign(simulate, true, seed=6, tests=CUTS, rate=6400.0, course=(10, 35, 15)), BELIEVED)
    with pytest.raises(SystemExit) as stop:
        main(["diagnose", str(tmp_path / "campaign.yaml"), "-m", str(tmp_path / "model.yaml"), "--decoys", "--json",
              str(tmp_path / "answer.json")])
    assert stop.value.code == 0
    said = json.loads((tmp_path / "answer.json").read_text())
    assert said["verdict"] == "missing_effect" and said["effects"] == [HIDDEN]
    assert said["decoys"] == {"offered": NAMES, "named": [HIDDEN]}
    assert f"{HIDDEN} is a law that no machine has: do not trust what this campaign seems" in capsys.readouterr().out
