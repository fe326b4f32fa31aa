// --- charts: the signals behind the score, with a cursor at the frame that the map shows ---

const PLOT = { left: 34, right: 8, top: 8, bottom: 16 }; // pixels around the plot

/** Least and greatest value of the axis: what the chart asks for, else all values and limits with some air. */
function axisOf(chart, drives) {
  const values = [...chart.limits];
  for (const drive of drives) {
    const { values: own, beside } = drive.charts[chart.key];
    for (const series of [own, beside ?? []]) for (const value of series) if (!Number.isNaN(value)) values.push(value);
  }
  const [least, greatest] = chart.shown;
  const low = least ?? Math.min(0, ...values);
  const high = greatest ?? Math.max(low, ...values);
  const air = 0.08 * Math.max(high - low, 0.5);
  return { low: least === null ? low - air : low, high: greatest === null ? high + air : high };
}

/** A step between ticks that a person would choose: 1, 2 or 5 times a power of ten, at most five of them. */
function tickStep(span) {
  const power = 10 ** Math.floor(Math.log10(span / 3));
  return [1, 2, 5, 10].map((times) => times * power).find((step) => span / step <= 5);
}

function plain(value, step) {
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return (Math.abs(value) < step / 2 ? 0 : value).toFixed(digits);
}

class Chart {
  constructor(chart, data, look, seek) {
    this.chart = chart;
    this.data = data;
    this.look = look;
    this.axis = axisOf(chart, data.drives);
    this.element = document.getElementById("chart-form").content.firstElementChild.cloneNode(true);
    this.canvas = this.element.querySelector("canvas");
    this.canvas.setAttribute("aria-label", this.summary());
    this.element.querySelector(".meaning").textContent = chart.about;
    const name = this.element.querySelector(".name");
    name.textContent = chart.title;
    const unit = document.createElement("span");
    unit.className = "soft";
    unit.textContent = ` ${chart.unit}`;
    name.append(unit);
    this.values = data.drives.map((_, index) => {
      const value = document.createElement("span");
      value.style.setProperty("--mine", `var(--planner-${index + 1})`);
      this.element.querySelector(".values").append(value);
      return value;
    });
    this.followPointer(seek);
  }

  /** In words for who does not see it. */
  summary() {
    const spans = this.data.drives.map((drive) => {
      const finite = drive.charts[this.chart.key].values.filter((value) => !Number.isNaN(value));
      if (!finite.length) return `${drive.planner}: none`;
      const [least, greatest] = [Math.min(...finite), Math.max(...finite)].map((value) => value.toFixed(2));
      return `${drive.planner}: ${least} to ${greatest} ${this.chart.unit}`;
    });
    const about = this.chart.about ? `, ${this.chart.about}` : "";
    return `${this.chart.title}${about}. ${spans.join("; ")}`;
  }

  followPointer(seek) {
    const toFrame = (event) => {
      const box = this.canvas.getBoundingClientRect();
      const share = (event.clientX - box.left - PLOT.left) / (box.width - PLOT.left - PLOT.right);
      seek(Math.round(share * (this.data.frames - 1)));
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      toFrame(event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (this.canvas.hasPointerCapture(event.pointerId)) toFrame(event);
    });
  }

  draw(frame) {
    const { context, width, height } = sized(this.canvas);
    if (!width) return;
    this.right = width - PLOT.right;
    this.bottom = height - PLOT.bottom;
    context.clearRect(0, 0, width, height);
    this.drawGrid(context);
    context.save();
    context.beginPath();
    context.rect(PLOT.left, PLOT.top - 6, this.right - PLOT.left + 6, this.bottom - PLOT.top + 12);
    context.clip();
    this.drawLimits(context);
    this.data.drives.forEach((drive, index) => this.drawDrive(context, drive, index));
    this.drawCursor(context, frame);
    context.restore();
    this.showValues(frame);
  }

  x(frame) {
    return PLOT.left + (frame / Math.max(1, this.data.frames - 1)) * (this.right - PLOT.left);
  }

  y(value) {
    const { low, high } = this.axis;
    return this.bottom - ((value - low) / (high - low)) * (this.bottom - PLOT.top);
  }

  drawGrid(context) {
    const { low, high } = this.axis;
    const step = tickStep(high - low);
    context.font = "10.5px system-ui, sans-serif";
    context.fillStyle = this.look.colour("soft");
    context.strokeStyle = this.look.colour("line");
    context.lineWidth = 1;
    context.textAlign = "right";
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      const y = Math.round(this.y(value)) + 0.5;
      strokeLine(context, [[PLOT.left, y], [this.right, y]]);
      context.fillText(plain(value, step), PLOT.left - 5, y + 3.5);
    }
    context.textAlign = "left";
    context.fillText("0 s", PLOT.left, this.bottom + 12.5);
    context.textAlign = "right";
    context.fillText(`${((this.data.frames - 1) * this.data.dt_s).toFixed(1)} s`, this.right, this.bottom + 12.5);
  }

  drawLimits(context) {
    context.strokeStyle = this.look.colour("poor");
    context.lineWidth = 1;
    context.globalAlpha = 0.75;
    context.setLineDash([4, 3]);
    for (const limit of this.chart.limits) {
      const y = this.y(limit);
      strokeLine(context, [[PLOT.left, y], [this.right, y]]);
    }
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  drawDrive(context, drive, index) {
    const { values, beside } = drive.charts[this.chart.key];
    context.strokeStyle = this.look.planner(index);
    if (beside) {
      context.globalAlpha = 0.55;
      context.lineWidth = 1.2;
      context.setLineDash([5, 3]);
      this.drawSeries(context, beside);
      context.setLineDash([]);
      context.globalAlpha = 1;
    }
    context.lineWidth = 1.7;
    this.drawSeries(context, values);
    const lost = drive.metrics.find(({ name, frame }) => name === this.chart.metric && frame !== null);
    if (lost && this.breaks(values[lost.frame])) this.drawLoss(context, lost.frame, values[lost.frame]);
  }

  /** Whether a value is beyond a limit: several charts stand for one metric, and not all of them cost its points. */
  breaks(value) {
    const [low = Infinity, high = Infinity] = this.chart.limits;
    return !Number.isNaN(value) && (value <= low || value >= high);
  }

  /** A ring where the metric behind the chart lost its points. */
  drawLoss(context, frame, value) {
    context.strokeStyle = this.look.colour("poor");
    context.lineWidth = 1.8;
    context.beginPath();
    context.arc(this.x(frame), this.y(value), 5, 0, 2 * Math.PI);
    context.stroke();
  }

  drawSeries(context, values) {
    let down = false;
    context.beginPath();
    values.forEach((value, frame) => {
      if (Number.isNaN(value)) {
        down = false;
        return;
      }
      if (down) context.lineTo(this.x(frame), this.y(value));
      else context.moveTo(this.x(frame), this.y(value));
      down = true;
    });
    context.stroke();
  }

  drawCursor(context, frame) {
    const x = Math.round(this.x(frame)) + 0.5;
    context.strokeStyle = this.look.colour("ink");
    context.globalAlpha = 0.55;
    context.lineWidth = 1;
    strokeLine(context, [[x, PLOT.top - 3], [x, this.bottom]]);
    context.globalAlpha = 1;
    this.data.drives.forEach((drive, index) => {
      const at = Math.round(frame);
      if (at >= drive.frames) return;
      this.drawDot(context, at, drive.charts[this.chart.key].values[at], this.look.planner(index), 3);
    });
  }

  drawDot(context, frame, value, colour, radius) {
    if (Number.isNaN(value)) return;
    context.fillStyle = colour;
    context.beginPath();
    context.arc(this.x(frame), this.y(value), radius, 0, 2 * Math.PI);
    context.fill();
  }

  showValues(frame) {
    this.data.drives.forEach((drive, index) => {
      const value = drive.charts[this.chart.key].values[Math.min(Math.round(frame), drive.frames - 1)];
      const digits = Math.abs(value) >= 100 ? 0 : 1;
      this.values[index].textContent = Number.isNaN(value) ? "–" : plain(value, 10 ** -digits);
    });
  }
}
