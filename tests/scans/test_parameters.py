"""Estimates of a scan's parameters: which one is kept, and what its sentence says."""

from jaxtat.base.units import Units
from jaxtat.scans.estimate import Estimate, Source
from jaxtat.scans.parameters import Parameters

UNITS = Units("m", "s")


def test_user_before_file_before_estimate_before_default():
    order = (Source.NOMINAL, Source.DEFAULT, Source.ESTIMATE, Source.FILE)
    p = Parameters({"alpha": 0.5, "pixels": None}, UNITS)
    for k, source in enumerate(order):
        p = p.with_(sound_speed=Estimate(k, "new", source=source))
        assert p["sound_speed"] == k  # a better source replaces
        for weaker in order[:k]:
            assert p.with_(sound_speed=Estimate(-1, source=weaker))["sound_speed"] == k
    p = p.with_(alpha=Estimate(0.1, "noise", source=Source.FILE), pixels=Estimate(65, "seen"))
    assert (p["alpha"], p.estimates["alpha"].sentence(UNITS)) == (0.5, "given")
    assert (p.gives("alpha"), p.gives("pixels"), p["pixels"]) == (True, False, 65)


def test_what_follows_from_a_given_option_is_the_users_too():
    p = Parameters({}, UNITS).with_(half_width=Estimate(2.0, "half", source=Source.USER))
    p = p.with_(half_width=Estimate(1.0, "the region"))
    assert (p["half_width"], p.gives("half_width"), p.given) == (2.0, True, {})


def test_a_step_changes_no_parameters_that_another_one_holds():
    p = Parameters({}, UNITS).with_(alpha=Estimate(0.1, "noise"))
    p.with_(alpha=Estimate(0.2, "noise")), p.fixed(alpha=0.3), p.doubted("why", ["alpha"])
    assert p.estimates == {"alpha": Estimate(0.1, "noise")}


def test_a_contradiction_makes_guesses_of_all_that_the_record_told():
    p = Parameters({}, UNITS).with_(
        model=Estimate("2d", "a tail", "guessed", Source.NOMINAL),
        alpha=Estimate(0.1, "noise", "likely", Source.ESTIMATE),
        order=Estimate((0, 1)),
    )
    doubted = p.doubted("no image explains {share:.0%}", ["model", "alpha"], share=0.5)
    assert [doubted.estimates[name].grade for name in p.estimates] == ["guessed", "guessed", "sure"]
    assert not doubted.nominal("model") and p.nominal("model")
    said = [doubted.estimates[name].sentence(UNITS) for name in ("model", "alpha")]
    assert said == ["a tail; no image explains 50%", "noise"]


def test_sentences_have_the_units_of_the_scan():
    why = "{n:.2g} of {a:length}, {a:length 2}, {t:time}, {c:speed}"
    found = Estimate(1.0, why, data={"n": 0.123, "a": 0.01234, "t": 2e-6, "c": 1500.0})
    assert found.sentence(UNITS) == "0.12 of 12.34 mm, 12 mm, 2 us, 1500 m/s"
    assert found.sentence(Units()) == "0.12 of 0.01234, 0.012, 2e-06, 1500"
    more = found.but("; {k}", "likely", k=3)
    assert more.sentence(UNITS).endswith("1500 m/s; 3") and more.value == found.value
