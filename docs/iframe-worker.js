/* Search where the site is opened as files: browsers give such pages no worker, so that its script runs in a hidden frame,
   with what a worker has (`importScripts`, messages both ways). */
"use strict";

class FrameWorker extends EventTarget {
  constructor(source) {
    super();
    this.onmessage = null;
    const frame = document.body.appendChild(document.createElement("iframe"));
    frame.hidden = true;
    const inside = frame.contentWindow;
    inside.importScripts = (...sources) =>
      sources.reduce((before, each) => before.then(() => run(inside, each)), Promise.resolve());
    inside.postMessage = (data) => {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      this.onmessage?.(event);
    };
    this.frame = frame;
    this.ready = run(inside, source);
  }

  postMessage(data) {
    this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data })));
  }

  terminate() {
    this.frame.remove();
  }
}

function run(inside, source) {
  return new Promise((loaded, failed) => {
    const script = inside.document.createElement("script");
    script.src = source;
    script.onload = loaded;
    script.onerror = failed;
    inside.document.body.append(script);
  });
}

// The theme looks for the second name, to find what its script loads.
if (location.protocol === "file:") window.Worker = window.IFrameWorker = FrameWorker;
