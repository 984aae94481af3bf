"use strict";
// every map of a page: layers to switch, to move, to zoom; window.mapViews holds one object each
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const make = (kind, attributes, text) => {
    const element = document.createElementNS(SVG, kind);
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    if (text !== undefined) element.textContent = text;
    return element;
  };
  // the largest of 1, 2, 5 times a power of ten that is not above the limit
  const round = (limit) => {
    const power = 10 ** Math.floor(Math.log10(limit));
    return [5, 2, 1].map((n) => n * power).find((n) => n <= limit * 1.000001);
  };
  const metres = (value, step) => value.toFixed(Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)));

  const mapView = (box) => {
    const svg = box.querySelector(".map-svg"), at = document.getElementById(`${box.dataset.map}-at`);
    const part = (name) => box.querySelector(`.map-${name}`);
    const given = svg.viewBox.baseVal;
    const known = { x: given.x, y: given.y, w: given.width, h: given.height };
    let view, home, camera = null;

    const draw = () => {
      svg.setAttribute("viewBox", [view.x, view.y, view.w, view.h].join(" "));
      const pixel = view.w / svg.clientWidth;  // metres of a pixel on the screen
      const axes = part("axes");
      axes.replaceChildren();
      const step = round(pixel * 130), size = 12 * pixel, edge = 4 * pixel;
      const label = (text, x, y, anchor) =>
        axes.append(make("text", { x, y, "text-anchor": anchor, style: `font-size:${size}px;stroke-width:${3 * pixel}px` }, text));
      for (let x = Math.ceil(view.x / step) * step; x < view.x + view.w; x += step) {
        axes.append(make("line", { x1: x, x2: x, y1: view.y, y2: view.y + view.h }));
        if (x > view.x + 7 * size) label(metres(x, step), x, view.y + view.h - edge, "middle");
      }
      for (let y = Math.ceil(view.y / step) * step; y < view.y + view.h; y += step) {
        axes.append(make("line", { y1: y, y2: y, x1: view.x, x2: view.x + view.w }));
        if (y < view.y + view.h - 2.5 * size) label(metres(-y || 0, step), view.x + edge, y + size / 3, "start");
      }
      label("x, y in m", view.x + edge, view.y + view.h - edge, "start");
      const bar = round(svg.clientWidth * pixel / 5);
      part("scale-bar").style.width = `${bar / pixel}px`;
      part("scale-text").textContent = bar >= 1 ? `${bar} m` : `${Math.round(bar * 100)} cm`;
      part("camera").replaceChildren();
      if (camera) {
        const turn = -camera.heading_rad * 180 / Math.PI, s = 9 * pixel;
        part("camera").append(make("path", {
          d: `M ${1.5 * s} 0 L ${-s} ${s} L ${-0.5 * s} 0 L ${-s} ${-s} Z`,
          transform: `translate(${camera.xy_m[0]} ${-camera.xy_m[1]}) rotate(${turn})`,
        }));
      }
    };
    // the view box takes the shape of the element, so that a pixel is as wide as it is high
    const fitted = (box) => {
      const shape = svg.clientWidth / svg.clientHeight;
      const w = Math.max(box.w, box.h * shape), h = w / shape;
      return { x: box.x + (box.w - w) / 2, y: box.y + (box.h - h) / 2, w, h };
    };
    const place = (event) => {
      const box = svg.getBoundingClientRect();
      return { x: view.x + (event.clientX - box.left) / box.width * view.w,
               y: view.y + (event.clientY - box.top) / box.height * view.h };
    };
    const zoom = (factor, at) => {
      at = at || { x: view.x + view.w / 2, y: view.y + view.h / 2 };
      const w = Math.min(Math.max(view.w * factor, home.w / 2000), home.w * 4), by = w / view.w;
      view = { x: at.x - (at.x - view.x) * by, y: at.y - (at.y - view.y) * by, w, h: view.h * by };
      draw();
    };
    const move = (dx, dy) => { view.x += dx; view.y += dy; draw(); };
    const reset = () => { home = fitted(known); view = { ...home }; draw(); };

    let width = svg.clientWidth;
    new ResizeObserver(() => { if (svg.clientWidth && svg.clientWidth !== width) { width = svg.clientWidth; reset(); } }).observe(svg);
    const pointers = new Map();
    svg.addEventListener("pointerdown", (e) => { svg.setPointerCapture(e.pointerId); pointers.set(e.pointerId, place(e)); });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, (e) => pointers.delete(e.pointerId));
    svg.addEventListener("pointermove", (e) => {
      const now = place(e), was = pointers.get(e.pointerId);
      if (at) at.textContent = `x ${now.x.toFixed(2)} m, y ${(-now.y).toFixed(2)} m`;
      if (!was) return;
      if (pointers.size === 1) {
        move(was.x - now.x, was.y - now.y);
      } else if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== e.pointerId)[1];
        const before = Math.hypot(was.x - other.x, was.y - other.y), after = Math.hypot(now.x - other.x, now.y - other.y);
        if (before > 0 && after > 0) zoom(before / after, other);
      }
      pointers.set(e.pointerId, place(e));
    });
    svg.addEventListener("wheel", (e) => {
      if (!e.ctrlKey && !e.metaKey) return;  // a page must scroll past its map
      e.preventDefault();
      zoom(Math.exp(e.deltaY * 0.002), place(e));
    }, { passive: false });
    svg.addEventListener("dblclick", (e) => zoom(0.5, place(e)));
    svg.addEventListener("keydown", (e) => {
      const by = view.w / 10, act = {
        ArrowLeft: () => move(-by, 0), ArrowRight: () => move(by, 0), ArrowUp: () => move(0, -by), ArrowDown: () => move(0, by),
        "+": () => zoom(0.7), "=": () => zoom(0.7), "-": () => zoom(1 / 0.7), "0": reset,
      }[e.key];
      if (act) { e.preventDefault(); act(); }
    });
    const buttons = { in: () => zoom(0.7), out: () => zoom(1 / 0.7), fit: reset };
    box.querySelectorAll("[data-do]").forEach((b) => b.addEventListener("click", () => buttons[b.dataset.do]()));
    reset();
    return {
      name: box.dataset.map,
      showCamera: (where) => { camera = where; draw(); },
      goTo: (x, y, wide) => { view = { ...fitted({ x: x - wide / 2, y: -y - wide / 2, w: wide, h: wide }) }; draw(); },
    };
  };
  window.mapViews = [...document.querySelectorAll(".map-box")].map(mapView);

  document.querySelectorAll("[data-layer]").forEach((box) => {
    const show = () => document.querySelectorAll(`[data-name="${box.dataset.layer}"]`).forEach((layer) => {
      if (layer instanceof SVGElement) layer.setAttribute("display", box.checked ? "inline" : "none");
      else layer.style.display = box.checked ? "block" : "none";
    });
    box.addEventListener("change", show);
    show();  // a browser may remember what was ticked
  });
  // a link to a thing: its frame comes into view, and its map goes there
  document.querySelectorAll("a[data-goto]").forEach((link) => link.addEventListener("click", () => {
    const view = window.mapViews.find((each) => each.name === link.dataset.goto);
    if (view) view.goTo(Number(link.dataset.x), Number(link.dataset.y), 3);
  }));
})();
