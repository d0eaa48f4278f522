async function start() {
  const scene = await readScene();
  const canvas = byId("view");
  const view = new SceneView(canvas, scene);
  const camera = new Camera(scene);
  const last = Math.max(0, ...scene.path.map((p) => p[0]), ...scene.objects.map((o) => o.last_frame));
  const state = {
    coloring: "texture",
    hidden: new Set(),
    answers: new Set(),
    best: null,
    selected: null,
    free: false,
    path: false,
    time: last,
    isVisible: (object) => !state.hidden.has(object.category) && object.first_frame <= state.time,
  };
  let waiting = false;
  const redraw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      view.draw(camera, state);
    });
  };
  const select = (object) => {
    state.selected = object ? object.id : null;
    showFacts(object);
    redraw();
  };
  const ask = (text) => {
    const found = search(scene.objects, text);
    state.answers = new Set(found.map((f) => f.object.id));
    state.best = found.length ? found[0].object.id : null;
    showAnswers(found, text, (object) => {
      select(object);
      camera.flyTo(object, redraw);
    });
    select(found.length ? found[0].object : null);
    if (found.length) camera.flyTo(found[0].object, redraw);
  };
  const resized = () => {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    camera.aspect = canvas.width / canvas.height;
    redraw();
  };
  attachControls(canvas, camera, {
    redraw,
    click: (event) => {
      const box = canvas.getBoundingClientRect();
      const scale = canvas.width / box.width;
      select(view.pick(camera, state, Math.floor((event.clientX - box.left) * scale), Math.floor((event.clientY - box.top) * scale)));
    },
  });
  attachPanel(scene, state, { redraw, ask, last, view, camera, canvas });
  new ResizeObserver(resized).observe(canvas);
  resized();
  // For tests and the browser's console.
  window.uppm = { scene, state, camera, view, ask, select };
}

function attachPanel(scene, state, { redraw, ask, last, view, camera, canvas }) {
  byId("search").addEventListener("submit", (event) => {
    event.preventDefault();
    ask(byId("prompt").value);
  });
  // The cross in the box empties it: the whole map is shown again.
  byId("prompt").addEventListener("search", () => byId("prompt").value || ask(""));
  for (const name of ["texture", ...Object.keys(scene.objects[0].colors)]) {
    byId("coloring").append(element("option", name, { value: name }));
  }
  byId("coloring").addEventListener("change", (event) => {
    state.coloring = event.target.value;
    showLegend(scene, state.coloring);
    redraw();
  });
  Object.assign(byId("time"), { min: 0, max: last, step: 1, value: last });
  byId("time-value").textContent = last;
  byId("time").addEventListener("input", (event) => {
    state.time = Number(event.target.value);
    byId("time-value").textContent = state.time;
    redraw();
  });
  for (const name of ["path", "free"]) {
    byId(name).addEventListener("change", (event) => {
      state[name] = event.target.checked;
      redraw();
    });
  }
  showCategories(scene, state, redraw);
  byId("whole").addEventListener("click", () => camera.fly(camera.home, redraw));
  byId("screenshot").addEventListener("click", () => {
    view.draw(camera, state);
    canvas.toBlob((blob) => {
      const link = element("a", "", { href: URL.createObjectURL(blob), download: `${scene.title}.png` });
      link.click();
      URL.revokeObjectURL(link.href);
    });
  });
}

start().catch((error) => {
  byId("failure").hidden = false;
  byId("failure").textContent = error.message;
});
