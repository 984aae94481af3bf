"use strict";
// the slider over the frames of a map's page
(() => {
  const byId = (id) => document.getElementById(id);
  const frames = JSON.parse(byId("frames-data").textContent);
  const slider = byId("frame-slider");
  if (slider) {
    const show = () => {
      const frame = frames[slider.value];
      byId("frame-photo").src = byId("frame-under").src = frame.photo;
      byId("frame-mask").src = frame.mask;
      byId("frame-depth").src = frame.depth;
      byId("frame-map").src = frame.map;
      byId("frame-range").textContent = `${frame.depth_range_m[0]} to ${frame.depth_range_m[1]} m`;
      const where = frame.xy_m ? `, camera at x ${frame.xy_m[0].toFixed(2)} m, y ${frame.xy_m[1].toFixed(2)} m` : "";
      byId("frame-text").textContent =
        `frame ${frame.name}, ${((frame.stamp_ns - frames[0].stamp_ns) / 1e9).toFixed(2)} s after the first${where}`;
      slider.setAttribute("aria-valuetext", `frame ${frame.name}`);
      window.mapViews.forEach((view) => view.showCamera(frame.xy_m ? frame : null));
    };
    slider.addEventListener("input", show);
    document.querySelectorAll("[data-step]").forEach((b) => b.addEventListener("click", () => {
      slider.value = Number(slider.value) + Number(b.dataset.step);
      show();
    }));
    show();
  }
})();
