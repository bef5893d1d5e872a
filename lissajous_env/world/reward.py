"""The reward and its terms, and the flags that end an episode."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.structs import struct_of
from lissajous_env.parameters.scenario import Task
from lissajous_env.world.state import Step, Tally

wp.set_module_options(OPTIONS)

TaskStruct = struct_of(Task)

TERMS = ("detection", "waiting", "collision", "idleness", "effort", "formation", "outside")


@wp.func
def give_reward(w: int, over: bool, task: TaskStruct, cells_total: int, step_out: Step, tally: Tally):
    """Reward each robot for the latest step: the weighted sum of the terms in `TERMS`."""
    waiting = task.reward_waiting * float(step_out.waiting[w]) * task.step
    idleness = task.reward_idleness * float(step_out.idle_ended[w]) * task.step / float(wp.max(cells_total, 1))
    formation = task.reward_formation * tally.phase_error[w] * task.step
    for i in range(step_out.reward.shape[1]):
        # A robot that was removed in an earlier step has no part in what the team earns after it.
        is_new = step_out.collisions[w, i] > 0 or step_out.outside[w, i] == 1
        part = wp.where(step_out.terminated[w, i] and not is_new, 0.0, 1.0)
        detection = task.reward_detection * float(step_out.detections[w, i])
        collision = task.reward_collision * float(step_out.collisions[w, i])
        effort = part * task.reward_effort * step_out.effort[w, i]
        outside = task.reward_outside * float(step_out.outside[w, i]) * task.step
        step_out.terms[w, i, 0] = detection
        step_out.terms[w, i, 1] = part * waiting
        step_out.terms[w, i, 2] = collision
        step_out.terms[w, i, 3] = part * idleness
        step_out.terms[w, i, 4] = effort
        step_out.terms[w, i, 5] = part * formation
        step_out.terms[w, i, 6] = outside
        reward = detection + part * (waiting + idleness + formation) + collision + effort + outside
        step_out.reward[w, i] = reward
        tally.returns[w, i] += wp.float64(reward)
        step_out.truncated[w, i] = over


@wp.func
def give_nothing(w: int, step_out: Step):
    """Reward a world that begins, or that ended in an earlier step."""
    for i in range(step_out.reward.shape[1]):
        for term in range(step_out.terms.shape[2]):
            step_out.terms[w, i, term] = 0.0
        step_out.reward[w, i] = 0.0
