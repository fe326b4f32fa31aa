//! Follows the route along centre lines with the Intelligent Driver Model, and stops at red lights; speaks JSON lines.
//! Build: rustc -O -o lane_follower lane_follower.rs   Run: --planner "exec:./lane_follower --speed 12"
mod json;

use json::{Reader, Value};
use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::os::fd::FromRawFd;

#[derive(Default)]
struct Line {
    points: Vec<(f64, f64)>,
    arc: Vec<f64>,
}

impl Line {
    fn append(&mut self, flat: &[f64]) {
        for point in flat.chunks_exact(2).map(|each| (each[0], each[1])) {
            let step = self.points.last().map_or(0.0, |last| (point.0 - last.0).hypot(point.1 - last.1));
            if self.points.is_empty() || step > 1e-6 {
                self.arc.push(self.arc.last().unwrap_or(&0.0) + step);
                self.points.push(point);
            }
        }
    }
    /// Arc length of the nearest point, and the distance to it; the last piece goes on for ever.
    fn project(&self, x: f64, y: f64) -> (f64, f64) {
        let mut best = (0.0, f64::INFINITY);
        for i in 0..self.points.len() - 1 {
            let ((ax, ay), (bx, by)) = (self.points[i], self.points[i + 1]);
            let length = self.arc[i + 1] - self.arc[i];
            let (ux, uy) = ((bx - ax) / length, (by - ay) / length);
            let end = if i + 2 < self.points.len() { length } else { f64::INFINITY };
            let along = ((x - ax) * ux + (y - ay) * uy).clamp(0.0, end);
            let off = (x - ax - along * ux).hypot(y - ay - along * uy);
            if off < best.1 {
                best = (self.arc[i] + along, off);
            }
        }
        best
    }
    fn pose(&self, at: f64) -> (f64, f64, f64) {
        let i = self.arc.partition_point(|arc| *arc <= at).clamp(1, self.arc.len() - 1) - 1;
        let ((ax, ay), (bx, by)) = (self.points[i], self.points[i + 1]);
        let heading = (by - ay).atan2(bx - ax);
        (ax + (at - self.arc[i]) * heading.cos(), ay + (at - self.arc[i]) * heading.sin(), heading)
    }
}

struct LaneFollower {
    speed: f64,
    maps: HashMap<u64, Value>,
    mission: Value,
    line: Line,
    gates: HashMap<String, f64>, // where connectors begin, along the line
}

impl LaneFollower {
    fn build(&mut self, x: f64, y: f64) {
        let map = &self.maps[&(self.mission.get("map").number() as u64)];
        let route: HashSet<&str> = self.mission.get("route").list().iter().map(Value::text).collect();
        let lanes = map.get("lanes").list().iter().chain(map.get("connectors").list());
        let mut left: Vec<&Value> = lanes.filter(|lane| route.contains(lane.get("roadblock_id").text())).collect();
        let off = |lane: &&Value| {
            let mut own = Line::default();
            own.append(&lane.get("centerline").numbers());
            own.project(x, y).1
        };
        let mut next = left.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)));
        while let Some(lane) = next {
            let (id, into) = (lane.get("id").text(), lane.get("to_lane_id").text());
            self.gates.insert(id.to_owned(), *self.line.arc.last().unwrap_or(&0.0));
            self.line.append(&lane.get("centerline").numbers());
            left.retain(|each| each.get("id").text() != id); // no ring is driven twice
            let onward = |each: &&Value| each.get("id").text() == into || each.get("from_lane_id").text() == id;
            next = left.iter().copied().find(onward);
        }
    }
    fn plan(&mut self, seen: &Value) -> String {
        let (ego, actors, signals) = (seen.get("ego"), seen.get("actors"), seen.get("signals"));
        let (x, y) = (ego.get("x_m").number(), ego.get("y_m").number());
        if self.line.points.is_empty() {
            self.build(x, y);
        }
        let here = self.line.project(x, y).0;
        let front = self.mission.get("shape").get("length_m").number() / 2.0;
        let column = |name: &str| actors.get(name).numbers();
        let (ax, ay, length, width) = (column("x_m"), column("y_m"), column("length_m"), column("width_m"));
        let (vx, vy) = (column("vx_mps"), column("vy_mps"));
        let (mut gap, mut leader) = (f64::INFINITY, 0.0);
        for i in 0..ax.len() {
            let (at, off) = self.line.project(ax[i], ay[i]);
            let free = at - here - front - length[i] / 2.0;
            if at > here && off < 1.3 + width[i] / 2.0 && free < gap {
                let heading = self.line.pose(at).2;
                (gap, leader) = (free, (vx[i] * heading.cos() + vy[i] * heading.sin()).max(0.0));
            }
        }
        for (id, status) in signals.get("connector_ids").list().iter().zip(signals.get("status").list()) {
            if let (Some(gate), 2.0) = (self.gates.get(id.text()), status.number()) {
                let free = gate - here - front;
                if free > 0.0 && free < gap {
                    (gap, leader) = (free, 0.0);
                }
            }
        }
        let mut columns = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
        let (mut at, mut v) = (here, ego.get("vx_mps").number());
        for k in 0..=40 {
            let (px, py, heading) = self.line.pose(at);
            for (column, value) in columns.iter_mut().zip([seen.get("time_s").number() + 0.1 * k as f64, px, py, heading]) {
                column.push(value);
            }
            let wished = 2.0 + (v * 1.5 + v * (v - leader) / (2.0 * 2.0_f64.sqrt())).max(0.0);
            let a = 1.0 - (v / self.speed).powi(4) - (wished / gap.max(0.1)).powi(2);
            v = (v + 0.1 * a.max(-6.0)).max(0.0);
            at += 0.1 * v;
            gap += 0.1 * (leader - v);
        }
        let [time, px, py, heading] = columns;
        format!(r#"{{"type":"plan","time_s":{time:?},"x_m":{px:?},"y_m":{py:?},"heading_rad":{heading:?}}}"#)
    }
}

fn main() {
    let words: Vec<String> = std::env::args().collect();
    let speed = if words.len() > 2 && words[1] == "--speed" { words[2].parse().expect("a speed") } else { 13.0 };
    let (line, maps, gates) = (Line::default(), HashMap::new(), HashMap::new());
    let mut planner = LaneFollower { speed, maps, mission: Value::None, line, gates };
    let (requests, mut replies) = unsafe { (File::from_raw_fd(3), File::from_raw_fd(4)) };
    let mut lines = BufReader::new(requests).lines();
    writeln!(replies, r#"{{"protocol": "interplan-sumo/planner", "versions": [1], "form": "json"}}"#).expect("a reader");
    lines.next(); // the welcome
    while let Some(Ok(line)) = lines.next() {
        let request = Reader::new(&line).value();
        let mut reply = r#"{"type":"ok"}"#.to_owned();
        match request.get("type").text() {
            "map" => drop(planner.maps.insert(request.get("map").number() as u64, request)),
            "start" => (planner.mission, planner.line, planner.gates) = (request, Line::default(), HashMap::new()),
            "plan" => reply = planner.plan(&request),
            _ => {}
        }
        writeln!(replies, "{reply}").expect("a reader");
    }
}
