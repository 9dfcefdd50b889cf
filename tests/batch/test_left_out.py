"""What a map says its own matches err by: baselines left out one by one and registered on the others."""

import numpy as np

from canon.site import Site
from lgprjax.batch.chance import OtherBaselines
from lgprjax.formats import MapFile
from lgprjax.registration import POOLED


def test_baselines_over_one_another_say_what_matches_err_by(site: Site) -> None:
    with MapFile.open(site.map) as source:
        chance = source.chance
    assert chance is not None
    # Two baselines of 40 m half beside each other: ten pieces each, less those at which no fix was ok.
    assert 10 <= chance.left_out <= 20
    assert 1.0 <= chance.sigma_scale <= 2.0
    assert chance.sigma_scale != POOLED.sigma_scale


def test_the_baseline_that_is_left_out_holds_no_data(site: Site) -> None:
    with MapFile.open(site.map) as source:
        others = OtherBaselines(source, 1)
        some = np.flatnonzero(source.drive == 1)[5:9]
        kept = np.flatnonzero(source.drive == 0)[5:9]
        assert not others.read_stations(some).valid.any()
        np.testing.assert_array_equal(others.read_stations(kept).profile, source.read_stations(kept).profile)


def test_two_baselines_tell_no_scatter(site: Site) -> None:
    with MapFile.open(site.map) as source:
        assert source.chance is not None
        assert source.chance.label_scatter_m == 0.0
