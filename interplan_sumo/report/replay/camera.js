// --- camera: which part of the map fills a pane; one for all panes, so that they can be compared ---

const LEAST_SCALE = 0.5; // pixels per metre
const GREATEST_SCALE = 60;
const LEAST_FOLLOWING_SCALE = 3.2; // a car is 16 pixels long
const GREATEST_FOLLOWING_SCALE = 14;
const USUAL_WIDTH_M = 95; // of the map in a pane at first
const AHEAD_SHARE = 0.14; // of the width by which the view leads an ego that is followed

class Camera {
  constructor(turnedRad) {
    this.cos = Math.cos(turnedRad);
    this.sin = Math.sin(turnedRad);
    this.scale = 0; // pixels per metre; 0 until a pane has a size
    this.centre = { x: 0, y: 0 };
    this.follows = true;
  }

  /** The usual scale for panes of this width. */
  start(width) {
    this.scale = Math.min(GREATEST_FOLLOWING_SCALE, Math.max(LEAST_FOLLOWING_SCALE, width / USUAL_WIDTH_M));
  }

  /** Screen pixels as metres of the map. */
  turned(dx, dy) {
    return { x: (dx * this.cos + dy * this.sin) / this.scale, y: (dx * this.sin - dy * this.cos) / this.scale };
  }

  /** Where a pane looks: ahead of its ego if it follows it, else where all do. */
  centreFor(ego, width) {
    if (!this.follows) return this.centre;
    const lead = this.turned(AHEAD_SHARE * width, 0);
    return { x: ego.x + lead.x, y: ego.y + lead.y };
  }

  /** The canvas transform from metres of the map to pixels of a pane. */
  matrix(centre, width, height, ratio) {
    const s = this.scale * ratio;
    const [a, b, c, d] = [s * this.cos, s * this.sin, s * this.sin, -s * this.cos];
    const [middleX, middleY] = [(width * ratio) / 2, (height * ratio) / 2];
    return [a, b, c, d, middleX - a * centre.x - c * centre.y, middleY - b * centre.x - d * centre.y];
  }

  /** The place on the map under a pixel of a pane. */
  place(centre, width, height, x, y) {
    const away = this.turned(x - width / 2, y - height / 2);
    return { x: centre.x + away.x, y: centre.y + away.y };
  }

  /** Move the map by pixels; whoever moves it looks for himself from then on. */
  drag(centre, dx, dy) {
    const away = this.turned(dx, dy);
    this.follows = false;
    this.centre = { x: centre.x - away.x, y: centre.y - away.y };
  }

  /** Zoom so that the place under a pixel stays there, unless the ego is followed. */
  zoom(factor, centre, width, height, x, y) {
    const kept = this.place(centre, width, height, x, y);
    this.scale = Math.min(GREATEST_SCALE, Math.max(LEAST_SCALE, this.scale * factor));
    if (this.follows) return;
    const now = this.place(centre, width, height, x, y);
    this.centre = { x: centre.x + kept.x - now.x, y: centre.y + kept.y - now.y };
  }

  /** Show all of an extent. */
  fit({ left, right, bottom, top }, width, height) {
    const [w, h] = [right - left, top - bottom];
    const across = Math.abs(w * this.cos) + Math.abs(h * this.sin);
    const upright = Math.abs(w * this.sin) + Math.abs(h * this.cos);
    const MARGIN_M = 16;
    this.follows = false;
    this.centre = { x: (left + right) / 2, y: (bottom + top) / 2 };
    this.scale = Math.min(width / (across + MARGIN_M), height / (upright + MARGIN_M), GREATEST_SCALE);
  }
}
