"use strict";
// The driver's part of the live page. It says what is held and pressed, and displays what Python answers; what keys
// mean is for Python (hugwbc/viz/drive_keys.py).
(() => {
  const KEYS = new Set(@KEYS@), HELP = @HELP@, ABOUT = @ABOUT@;
  const held = new Set(), presses = [], buttonsBefore = new Set();
  const pad = [0, 0, 0, 0];
  const socket = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/drive`;

  // A worker talks to Python: drawing can keep the page's own thread busy for longer than Python waits for a sign of
  // life. It lets go of all keys when the page's own thread has said nothing for a second.
  const code = `
    let said = {}, presses = [], heard = -1e9, line = null;
    function connect(address) {
      line = new WebSocket(address);
      line.onmessage = (event) => postMessage(JSON.parse(event.data));
      line.onclose = () => { postMessage({ lost: true }); setTimeout(connect, 500, address); };
    }
    onmessage = (event) => {
      if (event.data.address) { connect(event.data.address); return; }
      said = event.data.said; presses.push(...event.data.presses); heard = performance.now();
    };
    setInterval(() => {
      if (line === null || line.readyState !== 1 || line.bufferedAmount > 0) return;
      const awake = performance.now() - heard < 1000;
      line.send(JSON.stringify(awake ? { ...said, presses } : {}));
      presses = [];
    }, 50);`;
  const worker = new Worker(URL.createObjectURL(new Blob([code], { type: "text/javascript" })));
  worker.postMessage({ address: socket });

  const dark = matchMedia("(prefers-color-scheme: dark)");
  function report() {
    const said = { held: [...held], axes: pad.some((value) => value !== 0) ? [...pad] : [], dark: dark.matches };
    const gamepads = [...(navigator.getGamepads?.() ?? [])].filter(Boolean);
    const gamepad = gamepads.find((one) => one.mapping === "standard");
    const unmapped = document.querySelector("#drive .unmapped");
    if (unmapped) unmapped.hidden = !gamepads.length || gamepad !== undefined;
    if (gamepad) {
      const moved = gamepad.axes.slice(0, 4).some((value) => Math.abs(value) > 0.1);
      if (moved) said.axes = gamepad.axes.slice(0, 4);
      said.squat = gamepad.buttons[6]?.value ?? 0;
      gamepad.buttons.forEach((button, index) => {
        if (button.pressed && !buttonsBefore.has(index)) presses.push(`Pad${index}`);
        if (button.pressed) buttonsBefore.add(index); else buttonsBefore.delete(index);
      });
    }
    worker.postMessage({ said, presses: presses.splice(0) });
  }
  setInterval(report, 50);

  const writes = (target) => target?.closest?.("textarea, [contenteditable=true], input:not([type=range]):not([type=checkbox])");
  // Captured at the window, before viser, which moves its camera with some of these keys.
  addEventListener("keydown", (event) => {
    if (!KEYS.has(event.code) || event.ctrlKey || event.metaKey || event.altKey || writes(event.target)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) presses.push(event.code);
    held.add(event.code);
    report();
  }, true);
  addEventListener("keyup", (event) => {
    if (!KEYS.has(event.code)) return;
    if (held.delete(event.code)) { event.preventDefault(); event.stopImmediatePropagation(); }
    report();
  }, true);
  // A key that is let go while another window has the keyboard is never reported.
  addEventListener("blur", () => { held.clear(); report(); });
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) { held.clear(); presses.push("hide"); report(); }
  });

  function build() {
    const box = document.createElement("section");
    box.id = "drive";
    box.setAttribute("aria-label", "Drive");
    const button = (action, text) => `<button type="button" data-action="${action}" aria-pressed="false">${text}</button>`;
    const rows = ABOUT.commands.map(([, label, unit]) =>
      `<tr><th scope="row">${label} [${unit}]</th><td></td><td></td><td></td></tr>`).join("");
    box.innerHTML = `
      <div class="row" role="group" aria-label="Gait">${ABOUT.gaits.map((gait) => button(gait, gait.replace("_", " "))).join("")}</div>
      <div class="row">${button("stop", "stop")}${button("reset", "reset")}${button("camera", "camera")}</div>
      <div class="row tasks" ${ABOUT.tasks.length ? "" : "hidden"}><label>task <select>${ABOUT.tasks.map((task) =>
        `<option value="${task}">${task.replaceAll("_", " ")}</option>`).join("")}</select></label>${button(`task:${ABOUT.tasks[0]}`, "do it")}</div>
      <div class="line" role="status"></div>
      <div class="unmapped" role="status" hidden>This browser has no standard mapping for this gamepad: use the keys.</div>
      <ul class="notes" aria-live="polite"></ul>
      <details class="values"><summary>Command and measured</summary>
        <table><thead><tr><th></th><th scope="col">asked</th><th scope="col">commanded</th><th scope="col">measured</th></tr></thead>
        <tbody>${rows}</tbody></table></details>
      <details class="keys"><summary>Keys and gamepad</summary>
        <div class="help">${HELP.map(([keys, what]) => `<kbd>${keys}</kbd><span>${what}</span>`).join("")}</div></details>`;
    document.body.append(box);
    box.querySelector("select").addEventListener("change", (event) => {
      box.querySelector(".tasks button").dataset.action = `task:${event.target.value}`;
      event.target.blur();  // the keys are for driving
    });
    box.querySelector(".values").open = innerWidth > 1100;  // narrower, it hides the legs
    box.addEventListener("click", (event) => {
      const pressed = event.target.closest("button");
      if (!pressed) return;
      presses.push(pressed.dataset.action);
      pressed.blur();  // the space bar is for stopping
      report();
    });
    const round = document.createElement("div");
    round.id = "drive-pad";
    round.innerHTML = "<i></i>";
    round.setAttribute("aria-label", "Touch pad: up walks, sideways turns");
    document.body.append(round);
    const move = (event) => {
      const frame = round.getBoundingClientRect(), reach = frame.width / 2;
      let x = (event.clientX - frame.left - reach) / reach, y = (event.clientY - frame.top - reach) / reach;
      const length = Math.max(1, Math.hypot(x, y));
      x /= length; y /= length;
      pad[1] = y; pad[2] = x;
      round.firstChild.style.transform = `translate(${36 * x}px, ${36 * y}px)`;
    };
    const release = () => { pad.fill(0); round.firstChild.style.transform = ""; };
    round.addEventListener("pointerdown", (event) => { round.setPointerCapture(event.pointerId); move(event); });
    round.addEventListener("pointermove", (event) => { if (event.buttons) move(event); });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) round.addEventListener(end, release);
    return box;
  }

  const number = (value) => value === null || value === undefined ? "" : (+value.toFixed(2) + 0).toFixed(2);  // no -0.00
  function show(box, status) {
    const line = box.querySelector(".line");
    if (status.lost) { line.textContent = "No connection to the robot."; return; }
    if (status.line === undefined) return;
    for (const button of box.querySelectorAll("button")) {
      const action = button.dataset.action;
      const on = action === status.gait || action === `task:${status.task}` || (action === "camera" && status.follows);
      button.setAttribute("aria-pressed", String(on));
      button.classList.toggle("coming", action === status.next && action !== status.gait);
    }
    box.querySelector('[data-action="camera"]').textContent = `camera ${status.camera}`;
    line.textContent = status.line;
    box.querySelector(".notes").replaceChildren(...status.notes.map((note) => {
      const entry = document.createElement("li");
      entry.textContent = note;
      return entry;
    }));
    const rows = box.querySelectorAll("tbody tr");
    ABOUT.commands.forEach(([name], index) => {
      const cells = rows[index].querySelectorAll("td");
      cells[0].textContent = number(status.asked[name]);
      cells[1].textContent = number(status.commanded[name]);
      cells[1].className = status.changed.includes(name) ? "changed" : "";
      cells[2].textContent = number(status.measured[name]);
    });
  }

  // On a phone viser's sliders come as a sheet over half of the picture; a click on its title folds it.
  function foldSheet(tries) {
    if (tries === 0 || !matchMedia("(max-width: 576px)").matches) return;
    const titles = [...document.querySelectorAll("#root *")].filter(
      (one) => one.childElementCount === 0 && one.textContent === ABOUT.title);
    if (titles.length) titles[0].click(); else setTimeout(foldSheet, 200, tries - 1);
  }

  addEventListener("DOMContentLoaded", () => {
    const box = build();
    foldSheet(100);
    worker.onmessage = (event) => show(box, event.data);
  });
})();
