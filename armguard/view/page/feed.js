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
    this.isResetting = false; // whether a reset was asked for and its outcome is not known
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
      if (commands[0].type === "outcome") {
        this.isResetting = false;
        return this.take(commands);
      }
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
      if (this.isResetting) this.tell("the view disconnected: the reset may not have arrived; reset again if the STOP is still latched");
      this.parted(reason);
      setTimeout(() => this.connect(), RETRY);
    };
  }

  get isOpen() {
    return Boolean(this.socket) && this.socket.readyState === WebSocket.OPEN;
  }

  say(words) {
    if (this.isOpen) this.socket.send(JSON.stringify(words));
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
    if (!this.isOpen) return this.tell("not sent: the view's server does not answer");
    this.isResetting = true;
    this.say({ type: "reset", token });
  }

  // The outcome of a reset that the server does not tell.
  tell(text) {
    this.isResetting = false;
    this.take([{ type: "outcome", text }]);
  }
}
