// Age of a state: the time since it came, plus its delay beyond the fastest of the last minute.
// The clocks of the two machines may differ by a constant: a queue between them is still detected.

const WINDOW_MS = 60_000;

export class Age {
  // fastest: least arrival time minus time of a state [ms], in the last minute and in the present one
  constructor() {
    this.forget();
  }

  forget() {
    this.arrived = this.behind = null;
    this.since = null;
    this.before = this.fastest = Infinity;
  }

  take(utc_s, now) {
    const took = now - 1000 * utc_s;
    if (this.since === null || now - this.since > WINDOW_MS) {
      [this.since, this.before, this.fastest] = [now, this.fastest, Infinity];
    }
    this.fastest = Math.min(this.fastest, took);
    this.arrived = now;
    this.behind = took - Math.min(this.before, this.fastest);
  }

  at(now) {
    return this.arrived === null ? Infinity : now - this.arrived + this.behind;
  }
}
