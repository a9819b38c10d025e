// The present, and the past on request, from the view's server. Each bundle of commands is answered
// by "done" once it is drawn; only then comes the next one. A moment of the past that was asked for is
// answered by a "seen" of its number, even where it cannot be drawn.
import { decode } from "./decode.js";

const RETRY = 1000; // [ms]

export class Feed {
  constructor(take, parted) {
    this.take = take;
    this.parted = parted;
    this.wishes = {}; // what the server is to know again after a reconnection
    this.waiting = null; // { number, drawn } of the moment of the past that was asked for last
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/feed${location.search}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.socket = socket;
      for (const wish of Object.values(this.wishes)) this.say(wish);
    };
    socket.onmessage = ({ data }) => {
      const commands = decode(new Uint8Array(data));
      if (commands[0].type === "outcome") return this.take(commands);
      try {
        this.take(commands);
      } finally {
        requestAnimationFrame(() => {
          this.say({ type: "done" });
          if (commands.some(({ type, number }) => type === "seen" && number === this.waiting?.number)) {
            const { drawn } = this.waiting;
            this.waiting = null;
            drawn();
          }
        });
      }
    };
    socket.onclose = ({ reason }) => {
      if (this.socket === socket) this.socket = null;
      this.parted(reason);
      setTimeout(() => this.connect(), RETRY);
    };
  }

  say(words) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(words));
  }

  seek(number, drawn) {
    this.wishes.seek = { type: "seek", number };
    if (number === null) delete this.wishes.seek;
    this.waiting = number === null ? null : { number, drawn };
    this.say({ type: "seek", number });
    if (number === null) drawn();
  }

  showVolume(volume) {
    this.wishes.layers = { type: "layers", volume };
    this.say(this.wishes.layers);
  }

  reset(token) {
    this.say({ type: "reset", token });
  }
}
