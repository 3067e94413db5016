"""A campaign that holds noise alone, on a sensor that drifts."""

import numpy as np

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import SILENT
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.files.campaign import Record
from testbed.files.manifest import Feed
from testbed.recording import Recording
from testbed.workshop import RPM
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import TESTS


def test_noise_on_a_drifting_sensor_says_nothing_of_the_model() -> None:
    """Of drift larger than the noise nothing is known either: the model is not called adequate for leaving it out."""
    random, rate = np.random.default_rng(5), 12800.0
    time = np.arange(20000) / rate
    records = []
    for number, (rpm, depth) in enumerate(TESTS[:3]):
        signal = 1e-6 * (random.standard_normal(time.size) + 2.0 * time + 1.5 * np.sin(2.0 * time + number))
        conditions = {"spindle_speed": rpm * RPM, "axial_depth_of_cut": depth * 1e-3, "feed_per_tooth": 1e-4,
                      "feed_per_revolution": 1e-4}
        recording = Recording({"displacement": signal}, rate, {"displacement": "m"}, "measured", conditions=conditions)
        records.append(Record(f"noise_{number}", "cut", recording, conditions, feed=Feed(1e-4, "tooth")))
    known = catalogue()
    found = diagnose(plant_of(known), [observe(one, BELIEVED) for one in records], BELIEVED, known)
    assert found.noise_floor < SILENT
    assert (found.verdict, found.effects) == ("undecided", ())
    assert found.sentence.startswith("Hardly anything but noise")
