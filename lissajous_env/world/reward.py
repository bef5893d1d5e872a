"""The events of a step, cleared at its beginning and counted by the stages, and the reward for them by terms."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ROBOT, stage

wp.set_module_options(OPTIONS)

FORMULAS = {
    "detection": "reward_detection * detections",
    "waiting": "reward_waiting * waiting * step",
    "collision": "reward_collision * collisions",
    "idleness": "reward_idleness * idle_ended * step / cells_total",
    "effort": "reward_effort * effort",
    "formation": "reward_formation * phase_error * step",
    "outside": "reward_outside * outside * step",
    "contamination": "reward_contamination * age_reduction * step",
    "observation": "reward_observation * in_sight * step",
}
"""Formula of each term: weights and step of `Task`, the rest of the structs of `lissajous_env.world.state`."""

TERMS = tuple(FORMULAS)
_TERMS = wp.constant(len(TERMS))


@stage(ROBOT, writes="latest: collisions, detections, idle_ended, in_sight, waiting")
def clear_events(w, i, clock, latest):
    """Clear the events of the step before."""
    latest.detections[w, i] = 0
    latest.collisions[w, i] = 0
    if i == 0:
        latest.in_sight[w] = 0
        latest.waiting[w] = 0
        latest.idle_ended[w] = wp.int64(0)


@stage(ROBOT, writes="latest: reward, terms; tally: returns", idle=True)
def give_reward(w, lane, lanes, task, cells_total, clock, contamination, latest, tally):
    """Reward each robot for the step: the sum of the terms in `TERMS` and of those of extensions."""
    count = latest.terms.shape[2]
    waiting = task.reward_waiting * float(latest.waiting[w]) * task.step
    idleness = task.reward_idleness * float(latest.idle_ended[w]) * task.step / float(wp.max(cells_total, 1))
    formation = task.reward_formation * tally.phase_error[w] * task.step
    observation = task.reward_observation * float(latest.in_sight[w]) * task.step
    age_reduction = task.reward_contamination * contamination.age_reduction[w] * task.step
    for i in range(lane, latest.reward.shape[1], lanes):
        if clock.active[w] == 0:  # the episode has ended
            for term in range(count):
                latest.terms[w, i, term] = 0.0
            latest.reward[w, i] = 0.0
        else:
            # A robot that was removed in an earlier step has no share in the team's later rewards.
            is_new = latest.collisions[w, i] > 0 or latest.outside[w, i] == 1
            part = wp.where(latest.terminated[w, i] and not is_new, 0.0, 1.0)
            detection = task.reward_detection * float(latest.detections[w, i])
            collision = task.reward_collision * float(latest.collisions[w, i])
            effort = part * task.reward_effort * latest.effort[w, i]
            outside = task.reward_outside * float(latest.outside[w, i]) * task.step
            latest.terms[w, i, 0] = detection
            latest.terms[w, i, 1] = part * waiting
            latest.terms[w, i, 2] = collision
            latest.terms[w, i, 3] = part * idleness
            latest.terms[w, i, 4] = effort
            latest.terms[w, i, 5] = part * formation
            latest.terms[w, i, 6] = outside
            latest.terms[w, i, 7] = part * age_reduction
            latest.terms[w, i, 8] = part * observation
            reward = detection + part * (waiting + idleness + formation + age_reduction) + collision + effort + outside
            reward += part * observation
            for term in range(_TERMS, count):
                latest.terms[w, i, term] = wp.where(part > 0.0, latest.terms[w, i, term], 0.0)
                reward += latest.terms[w, i, term]
            latest.reward[w, i] = reward
            tally.returns[w, i] += wp.float64(reward)
