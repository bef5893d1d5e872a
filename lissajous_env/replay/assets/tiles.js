// The numbers above a picture: detections, mean detection time, collisions and worst-case undetected time so far.

import { element, number } from "./words.js";

export class Tiles {
  constructor(box, episode) {
    Object.assign(this, { box, episode, moment: -1 });
    if (episode.raw.targets.count > 0) {
      this.detected = this.add("detected");
      this.waited = this.add("mean detection time");
    }
    this.collisions = this.add("collisions");
    if (episode.ground.ageWorst) this.undetected = this.add("worst-case undetected time");
  }

  add(words) {
    const value = element("b");
    this.box.append(element("div", "pair muted tile", value, element("span", "", words)));
    return value;
  }

  move(time) {
    const { episode } = this,
      { moment, now } = episode.at(time);
    if (this.moment === moment) return;
    this.moment = moment;
    if (this.detected) this.count(now * episode.raw.every);
    this.collisions.textContent = String(episode.collisions[moment]);
    this.collisions.classList.toggle("alarm", episode.collisions[moment] > 0);
    if (this.undetected) this.undetected.textContent = `${number(episode.ground.ageWorst[moment])} s`;
  }

  // Count the targets that have appeared and been detected up to a step, and the time until then.
  count(step) {
    const { appears, found } = this.episode.raw.targets;
    let came = 0,
      detected = 0,
      waited = 0;
    for (let t = 0; t < appears.length; t++) {
      if (appears[t] > step) continue;
      came += 1;
      const done = found[t] >= 0 && found[t] <= step;
      detected += done;
      waited += Math.max((done ? found[t] : step) - appears[t], 0);
    }
    this.detected.textContent = `${detected} / ${came}`;
    this.waited.textContent = came ? `${number((waited / came) * this.episode.raw.step)} s` : "–";
  }
}
