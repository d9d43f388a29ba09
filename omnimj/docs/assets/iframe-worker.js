/* The search of a site that is opened from disk: browsers refuse workers there, an inline frame takes their place. */
if (location.protocol === "file:" && !window.FrameWorker) {
  const load = "window.importScripts = (...urls) => urls.reduce((before, url) => before.then(() =>"
    + " new Promise((done, failed) => { const script = document.createElement('script'); script.src = url;"
    + " script.onload = done; script.onerror = failed; document.body.appendChild(script); })), Promise.resolve());";
  window.FrameWorker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.appendChild(this.frame);
      this.window = this.frame.contentWindow;
      this.receive = event => {
        if (event.source !== this.window) return;
        this.dispatchEvent(new MessageEvent("message", { data: event.data }));
        if (this.onmessage) this.onmessage(event);
      };
      window.addEventListener("message", this.receive);
      const page = this.window.document;
      page.open();
      page.write("<html><body><script>self.postMessage = data => parent.postMessage(data, '*'); " + load
        + "<\/script><script src='" + url + "'><\/script></body></html>");
      page.close();
      this.ready = new Promise(done => { this.window.onload = done; });
    }
    postMessage(data) {
      this.ready.then(() => this.window.dispatchEvent(new MessageEvent("message", { data })));
    }
    terminate() {
      window.removeEventListener("message", this.receive);
      this.frame.remove();
    }
  };
  window.Worker = window.FrameWorker;
}
