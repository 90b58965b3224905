// The connection of a live page: what the scene sends, what the sliders ask. One page, one socket, to its own server only.
class Live {
  // `note` takes what the scene tells, `stage` shows it.
  constructor(stage, address, note) {
    this.stage = stage;
    this.open = false;
    this.backdrop = new Backdrop(stage);
    const socket = this.socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.open = true;
      stage.controls.enable(true);
    };
    socket.onmessage = (event) => {
      if (typeof event.data !== "string") stage.receive(new Uint8Array(event.data));
      else note(JSON.parse(event.data));
    };
    socket.onclose = () => {
      this.open = false;
      stage.controls.enable(false);
      this.ended();
    };
  }

  send(message) {
    if (this.open) this.socket.send(JSON.stringify(message));
  }

  // The picture stays; it says that it is no longer live.
  ended() {
    const words = make("p", "ended", null, "The program that served this page has ended: the picture stays as it is.");
    (this.stage.controls.panel || document.body).prepend(words);
    if (!this.stage.touched) this.stage.fit();
  }
}
