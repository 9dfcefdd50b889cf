"""Who drives in a closed loop: engaged once for all, and a stop goes on."""

import jax.numpy as jnp

from lgprjax.simulation.handover import Handover, init_handover, step_handover


def _after(handover: Handover, *, sound: bool, stop: bool) -> tuple[bool, bool]:
    found = step_handover(handover, sound=jnp.asarray(sound), stop=jnp.asarray(stop))
    return bool(found.engaged), bool(found.stopping)


def test_the_driver_engages_when_he_sees_no_reason_not_to_and_stays_out() -> None:
    assert _after(init_handover(), sound=False, stop=False) == (False, False)
    assert _after(init_handover(), sound=True, stop=False) == (True, False)
    assert _after(Handover(jnp.asarray(True), jnp.asarray(False)), sound=False, stop=False) == (True, False)


def test_a_stop_is_of_the_computer_that_drives_and_goes_on() -> None:
    # What navigation asks for while the driver drives, in the tick in which he engages too, stops nobody.
    assert _after(init_handover(), sound=False, stop=True) == (False, False)
    assert _after(init_handover(), sound=True, stop=True) == (True, False)
    assert _after(Handover(jnp.asarray(True), jnp.asarray(False)), sound=True, stop=True) == (True, True)
    assert _after(Handover(jnp.asarray(True), jnp.asarray(True)), sound=True, stop=False) == (True, True)
