// The clock of the page, shared by all episodes, charts and the timeline.

export class Player {
  constructor(duration, step, onMove) {
    Object.assign(this, { duration, step, onMove, time: 0, speed: 1, playing: false, before: 0 });
  }

  // Format a time with the decimals of the step [s].
  words(time = this.time) {
    return time.toFixed(Math.min(Math.max(Math.ceil(-Math.log10(this.step) - 1e-9), 0), 12));
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.onMove(this);
  }

  toggle(playing = !this.playing) {
    if (playing && this.time >= this.duration - 1e-9) this.time = 0;
    this.playing = playing;
    this.before = 0;
    if (playing) requestAnimationFrame((now) => this.tick(now));
    this.onMove(this);
  }

  tick(now) {
    if (!this.playing) return;
    const passed = this.before ? Math.min((now - this.before) / 1000, 0.25) : 0;
    this.before = now;
    this.time = Math.min(this.time + passed * this.speed, this.duration);
    if (this.time >= this.duration) this.playing = false;
    this.onMove(this);
    if (this.playing) requestAnimationFrame((later) => this.tick(later));
  }
}
