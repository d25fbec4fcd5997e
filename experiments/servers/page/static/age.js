// How old a state is: what passed since it came, and what it took on the way beyond the fastest of the last minute.
// Clocks of the two machines need not agree, only run evenly: a queue somewhere in between shows all the same.

const WINDOW_MS = 60_000;

export class Age {
  // fastest: of each of the last and the present minute, arrival less time of the state [ms]
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
