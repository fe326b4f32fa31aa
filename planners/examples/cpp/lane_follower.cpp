// Follows the route along centre lines with the Intelligent Driver Model, and stops at red lights.
// Build: g++ -O2 -std=c++20 -o lane_follower lane_follower.cpp   Run: --planner "exec:./lane_follower --speed 12"
#include "msgpack.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

struct Line {
    std::vector<double> x, y, arc;
    void append(const std::vector<double>& points) {  // x, y, x, y
        for (size_t i = 0; i + 1 < points.size(); i += 2) {
            const double step = x.empty() ? 0.0 : std::hypot(points[i] - x.back(), points[i + 1] - y.back());
            if (!x.empty() && step < 1e-6) continue;
            arc.push_back(x.empty() ? 0.0 : arc.back() + step);
            x.push_back(points[i]);
            y.push_back(points[i + 1]);
        }
    }
    // Arc length of the nearest point, and the distance to it.
    std::pair<double, double> project(double px, double py) const {
        std::pair<double, double> best{0.0, INFINITY};
        for (size_t i = 0; i + 1 < x.size(); ++i) {
            const double length = arc[i + 1] - arc[i], ux = (x[i + 1] - x[i]) / length, uy = (y[i + 1] - y[i]) / length;
            const double end = i + 2 < x.size() ? length : INFINITY;  // the last piece goes on
            const double along = std::clamp((px - x[i]) * ux + (py - y[i]) * uy, 0.0, end);
            const double off = std::hypot(px - x[i] - along * ux, py - y[i] - along * uy);
            if (off < best.second) best = {arc[i] + along, off};
        }
        return best;
    }
    void pose(double at, double& px, double& py, double& heading) const {
        size_t i = std::upper_bound(arc.begin(), arc.end(), at) - arc.begin();
        i = std::clamp<size_t>(i, 1, arc.size() - 1) - 1;
        heading = std::atan2(y[i + 1] - y[i], x[i + 1] - x[i]);
        px = x[i] + (at - arc[i]) * std::cos(heading);  // beyond the end it goes straight on
        py = y[i] + (at - arc[i]) * std::sin(heading);
    }
};

class LaneFollower {
public:
    explicit LaneFollower(double speed) : speed_(speed) {}
    void keep(const Value& map) { maps_[static_cast<int>(map["map"].number)] = map; }
    void start(const Value& mission) {
        map_ = &maps_.at(static_cast<int>(mission["map"].number));
        route_.clear();
        for (const Value& block : mission["route"].list) route_.insert(block.bytes);
        front_ = mission["shape"]["length_m"].number / 2.0;
        line_ = Line{};
        gates_.clear();
    }
    std::string plan(const Value& seen) {
        const Value& ego = seen["ego"];
        if (line_.x.empty()) build(ego["x_m"].number, ego["y_m"].number);
        const double here = line_.project(ego["x_m"].number, ego["y_m"].number).first;
        double gap = INFINITY, leader = 0.0;
        const Value& actors = seen["actors"];
        const auto x = actors["x_m"].numbers(), y = actors["y_m"].numbers(), length = actors["length_m"].numbers(),
                   width = actors["width_m"].numbers(), vx = actors["vx_mps"].numbers(), vy = actors["vy_mps"].numbers();
        for (size_t i = 0; i < x.size(); ++i) {
            const auto [at, off] = line_.project(x[i], y[i]);
            const double free = at - here - front_ - length[i] / 2.0;
            if (at > here && off < 1.3 + width[i] / 2.0 && free < gap) {
                double px, py, heading;
                line_.pose(at, px, py, heading);
                gap = free;
                leader = std::max(0.0, vx[i] * std::cos(heading) + vy[i] * std::sin(heading));
            }
        }
        const Value& signals = seen["signals"];
        for (size_t i = 0; i < signals["connector_ids"].list.size(); ++i) {
            const auto gate = gates_.find(signals["connector_ids"][i].bytes);
            if (gate == gates_.end() || signals["status"].bytes[i] != 2) continue;  // red
            const double free = gate->second - here - front_;
            if (free > 0.0 && free < gap) gap = free, leader = 0.0;
        }
        std::vector<double> time, px, py, heading;
        double v = ego["vx_mps"].number, at = here;
        for (int k = 0; k <= 40; ++k, gap += 0.1 * (leader - v)) {
            time.push_back(seen["time_s"].number + 0.1 * k);
            px.emplace_back(), py.emplace_back(), heading.emplace_back();
            line_.pose(at, px.back(), py.back(), heading.back());
            const double wished = 2.0 + std::max(0.0, v * 1.5 + v * (v - leader) / (2.0 * std::sqrt(1.0 * 2.0)));
            const double a = 1.0 - std::pow(v / speed_, 4) - std::pow(wished / std::max(gap, 0.1), 2);
            v = std::max(0.0, v + 0.1 * std::max(a, -6.0));
            at += 0.1 * v;
        }
        const std::string columns = packed("time_s") + packed(time) + packed("x_m") + packed(px) + packed("y_m") +
                                    packed(py) + packed("heading_rad") + packed(heading);
        return "\x85" + packed("type") + packed("plan") + columns;
    }

private:
    void build(double x, double y) {
        std::map<std::string, const Value*> on_route;
        std::multimap<std::string, const Value*> leaving;
        for (const char* kind : {"lanes", "connectors"})
            for (const Value& lane : (*map_)[kind].list) {
                if (!route_.count(lane["roadblock_id"].bytes)) continue;
                on_route[lane["id"].bytes] = &lane;
                if (lane.has("from_lane_id")) leaving.emplace(lane["from_lane_id"].bytes, &lane);
            }
        const Value* lane = nullptr;
        for (double best = INFINITY; const auto& [id, each] : on_route) {
            Line own;
            own.append((*each)["centerline"].numbers());
            if (const double off = own.project(x, y).second; off < best) best = off, lane = each;
        }
        while (lane != nullptr) {
            if (lane->has("from_lane_id")) gates_[(*lane)["id"].bytes] = line_.arc.empty() ? 0.0 : line_.arc.back();
            line_.append((*lane)["centerline"].numbers());
            const std::string id = (*lane)["id"].bytes;
            const auto next = leaving.find(id);
            const auto into = lane->has("to_lane_id") ? on_route.find((*lane)["to_lane_id"].bytes) : on_route.end();
            on_route.erase(id);  // no ring is driven twice
            lane = into != on_route.end() ? into->second : next != leaving.end() ? next->second : nullptr;
        }
    }
    double speed_, front_ = 2.6;
    std::map<int, Value> maps_;
    const Value* map_ = nullptr;
    std::set<std::string> route_;
    std::map<std::string, double> gates_;  // where connectors begin, along the line
    Line line_;
};

int main(int count, char** words) {
    LaneFollower planner(count > 2 && std::string(words[1]) == "--speed" ? std::stod(words[2]) : 13.0);
    FILE *requests = fdopen(3, "rb"), *replies = fdopen(4, "wb");
    std::fputs("{\"protocol\": \"interplan-sumo/planner\", \"versions\": [1], \"form\": \"msgpack\"}\n", replies);
    std::fflush(replies);
    for (int c = 0; c != '\n';)  // the welcome
        if ((c = std::fgetc(requests)) == EOF) return 0;
    for (unsigned char size[4]; std::fread(size, 1, 4, requests) == 4;) {
        std::string message(size[0] | size[1] << 8 | size[2] << 16 | static_cast<size_t>(size[3]) << 24, '\0');
        if (std::fread(message.data(), 1, message.size(), requests) != message.size()) return 1;
        std::string reply = "\x81" + packed("type") + packed("ok");
        try {
            const Value request = Reader(message).value();
            const std::string& type = request["type"].bytes;
            if (type == "map") planner.keep(request);
            if (type == "start") planner.start(request);
            if (type == "plan") reply = planner.plan(request);
        } catch (const std::exception& error) {
            reply = "\x82" + packed("type") + packed("error") + packed("message") + packed(error.what());
        }
        const uint32_t length = reply.size();
        for (int i = 0; i < 4; ++i) std::fputc(length >> 8 * i & 0xff, replies);
        std::fwrite(reply.data(), 1, reply.size(), replies);
        std::fflush(replies);
    }
}
