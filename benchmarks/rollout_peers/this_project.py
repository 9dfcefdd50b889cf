"""This project's rollouts: ``roll_out_many``, and ``roll_out`` with its gradient."""

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.rollout_operations import operations_a_step, peak_operations
from benchmarks.rollout_peers.work import arguments, finish, seconds
from benchmarks.rollout_problem import as_rollout, load_problem
from lgprjax.vehicle import LookAhead, Servo, roll_out, roll_out_many

GRADIENT_LANES = 4096


def main() -> None:
    """The program."""
    chosen = arguments("this_project")
    problem = load_problem(chosen.problem)
    spec, path, lane, start = as_rollout(problem, chosen.steps)
    lane, start = jax.tree.map(np.asarray, (lane, start))
    taken_s = seconds(lambda: roll_out_many(spec, path, lane, start), chosen.repeats)
    final, metrics = roll_out_many(spec, path, lane, start)
    few = problem._replace(lanes=problem.lanes[:, :GRADIENT_LANES])
    _, _, few_lane, few_start = as_rollout(few, chosen.steps)

    def cost(look_ahead: LookAhead, servo: Servo) -> jax.Array:
        changed = few_lane._replace(look_ahead=look_ahead, servo=servo)
        return jnp.mean(roll_out(spec, path, changed, few_start)[1].rms_m)

    numbers = (few_lane.look_ahead, few_lane.servo)
    value, both = jax.jit(cost), jax.jit(jax.value_and_grad(cost, argnums=(0, 1)))
    value_s = seconds(lambda: jax.block_until_ready(value(*numbers)), chosen.repeats)
    both_s = seconds(lambda: jax.block_until_ready(both(*numbers)), chosen.repeats)
    pose = np.stack([final.x_m, final.y_m, final.cos_yaw, final.sin_yaw])
    finish(
        chosen, taken_s, len(start.x_m), pose, np.asarray(metrics.rms_m),
        value_s=min(value_s), value_and_gradient_s=min(both_s), gradient_lanes=few.lanes.shape[1],
        operations=operations_a_step(jax.make_jaxpr(roll_out, static_argnums=0)(spec, path, lane, start)),
        peak_operations=peak_operations(),
    )  # fmt: skip


if __name__ == "__main__":
    main()
