// In the place of the pilot's page's own stream.js: what a server says elsewhere comes from the page around this frame.

let history = { points: [], events: [] };

/** The page changes nothing, and knows of no plan. */
const ANSWERS = {
  history: () => history,
  route: () => ({ home: null, path: [], fence: [] }),
  capabilities: () => ({ authorised: false, mission_upload: false, parameters_apply: false }),
};

export async function ask(path) {
  return new Response(JSON.stringify(ANSWERS[path.match(/v1\/(\w+)/)[1]]()));
}

export class Stream {
  #live = false;

  constructor(handlers) {
    this.handlers = handlers;
  }

  start() {
    addEventListener("message", ({ data, source }) => {
      if (source !== parent) return;
      const view = JSON.parse(data);
      history = view.history;
      this.handlers.onState("live", 0, !this.#live);
      this.#live = true;
      this.handlers.onSinks(view.sinks);
      this.handlers.onSnapshot(view.snapshot);
    });
  }
}
