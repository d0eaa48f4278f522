const byId = (id) => document.getElementById(id);

/** An element with text; text is never read as markup, since labels come from anywhere. */
function element(tag, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  if (text !== "") made.textContent = text;
  return made;
}

function swatch(rgb) {
  const made = element("span", "", { className: "swatch" });
  made.style.background = `rgb(${rgb.join(",")})`;
  return made;
}

/** Everything that is known of one object. */
function showFacts(object) {
  const box = byId("facts");
  box.replaceChildren();
  box.hidden = !object;
  if (!object) return;
  box.append(element("h2", `${object.name} #${object.id}`));
  const most = Math.max(...Object.values(object.labels), 1);
  for (const [label, count] of Object.entries(object.labels)) {
    const bar = element("div", "", { className: "bar" });
    const fill = element("i");
    fill.style.width = `${(100 * count) / most}%`;
    bar.append(fill, element("span", `${label} · ${count}`));
    box.append(bar);
  }
  const list = element("dl");
  for (const [name, value] of factRows(object)) list.append(element("dt", name), element("dd", value));
  box.append(list);
  for (const jpeg of object.crops) box.append(element("img", "", { src: `data:image/jpeg;base64,${jpeg}`, alt: "view" }));
  if (!object.crops.length) box.append(element("p", "No pictures: the map keeps none. Export with --sequence.", { className: "hint" }));
}

function factRows(object) {
  const metres = (values) => (values ? values.map((v) => v.toFixed(2)).join(" × ") : "-");
  const confidence = object.confidence === null ? "" : ` (${Math.round(100 * object.confidence)} %)`;
  const rows = [
    ["category", object.category + confidence],
    ["voxel", `${(100 * object.voxel_size).toFixed(0)} cm`],
    ["frames", `${object.first_frame} to ${object.last_frame}, seen in ${object.views}`],
    ["size, m", metres(object.extent)],
    ["centre, m", object.center ? object.center.map((v) => v.toFixed(2)).join(", ") : "-"],
    ["state", object.state],
  ];
  if (object.change) rows.push(["since", object.change.state]);
  return rows;
}

/** What the colours mean, where that is not said elsewhere. */
function showLegend(scene, coloring) {
  const legend = byId("legend");
  legend.replaceChildren();
  const entry = (rgb, text) => {
    const item = element("span");
    item.append(swatch(rgb), text);
    legend.append(item);
  };
  if (coloring === "confidence") {
    scene.confidenceColors.forEach((rgb, k) => entry(rgb, `${50 * k} %`));
  }
  if (coloring !== "change") return;
  if (!scene.gone.length && scene.objects.every((o) => !o.change)) {
    legend.append("This map was not compared with an older one.");
    return;
  }
  for (const [state, rgb] of Object.entries(scene.changeColors)) entry(rgb, state);
  for (const gone of scene.gone) legend.append(element("span", `${gone.state}: ${gone.label}`));
}

/** One box a category, with the number of its submaps. */
function showCategories(scene, state, changed) {
  const counts = new Map();
  for (const object of scene.objects) {
    const entry = counts.get(object.category) || { count: 0, rgb: object.colors.category };
    counts.set(object.category, { ...entry, count: entry.count + 1 });
  }
  const boxes = [...counts].sort(([a], [b]) => a.localeCompare(b)).map(([category, { count, rgb }]) => {
    const label = element("label");
    const box = element("input", "", { type: "checkbox", checked: true });
    box.addEventListener("change", () => {
      state.hidden[box.checked ? "delete" : "add"](category);
      changed();
    });
    label.append(box, " ", swatch(rgb), `${category} (${count})`);
    byId("categories").append(label);
    return [category, box];
  });
  const setAll = (shown) => (event) => {
    event.preventDefault();
    for (const [category, box] of boxes) {
      box.checked = shown;
      state.hidden[shown ? "delete" : "add"](category);
    }
    changed();
  };
  byId("all").addEventListener("click", setAll(true));
  byId("none").addEventListener("click", setAll(false));
}

function showAnswers(found, text, choose) {
  const list = byId("answers");
  list.replaceChildren();
  const said = found.length === 1 ? "1 match" : `${found.length} matches`;
  byId("answer").textContent = !text.trim() ? "" : found.length ? said : `No label here has “${text.trim()}” in it.`;
  for (const { object } of found.slice(0, 12)) {
    const button = element("button", `${object.name} #${object.id}`, { type: "button" });
    button.addEventListener("click", () => choose(object));
    const item = element("li");
    item.append(button);
    list.append(item);
  }
}
