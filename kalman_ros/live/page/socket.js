// SPDX-License-Identifier: Apache-2.0
// The socket: commands with numbers, and their answers.

const waiting = new Map();
const id = Math.floor(Math.random() * 1e6);
let socket = null, count = 0;

// Connect, and again whenever the connection ends; `receive` gets each message.
export function connect(receive, lost) {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.onmessage = (event) => receive(JSON.parse(event.data));
  socket.onclose = () => {
    lost();
    forget();
    setTimeout(() => connect(receive, lost), 1000);
  };
}

export function forget() {
  const done = [...waiting.values()];
  waiting.clear();
  done.forEach((each) => each(''));
}

// Send a command; `done` gets the reason of a refusal, or ''.
export function send(command, done = () => {}) {
  if (socket?.readyState !== WebSocket.OPEN) { done(''); return; }
  const n = ++count;
  waiting.set(n, done);
  socket.send(JSON.stringify({ ...command, n: id * 1e6 + n }));
}

// Handle an answer; return whether it is one to this tab.
export function answered({ n, error }) {
  if (n === null || Math.floor(n / 1e6) !== id) return false;
  const done = waiting.get(n % 1e6);
  waiting.delete(n % 1e6);
  done?.(error);
  return true;
}

// Sends at most one command at a time, and then the newest of those that came meanwhile.
export class Newest {
  constructor(send) {
    this.send = send;
    this.busy = false;
    this.next = null;
  }

  put(command, done = () => {}) {
    if (this.busy) { this.next = [command, done]; return; }
    this.busy = true;
    this.send(command, (error) => {
      this.busy = false;
      if (this.next) { const next = this.next; this.next = null; this.put(...next); }
      else done(error);
    });
  }
}
