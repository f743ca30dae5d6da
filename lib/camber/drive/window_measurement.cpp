#include "camber/drive/window_measurement.h"

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace camber {
namespace {

using nlohmann::json;

json of_numbers(const double* values, Eigen::Index count) {
  return json(std::vector<double>(values, values + count));
}

template <class Matrix>
void fill(const json& from, Matrix* matrix) {
  const auto values = from.get<std::vector<double>>();
  if (static_cast<Eigen::Index>(values.size()) != matrix->size()) {
    throw std::invalid_argument("a drive window: wrong number of values");
  }
  std::copy(values.begin(), values.end(), matrix->data());
}

json of_pose(const SE3& pose) { return of_numbers(pose.data(), 7); }

SE3 pose_of(const json& from) {
  SE3 out;
  const auto values = from.get<std::vector<double>>();
  if (values.size() != 7) throw std::invalid_argument("a drive window: a pose has 7 values");
  std::copy(values.begin(), values.end(), out.data());
  return out;
}

json of_plane(const UncertainPlane& p) {
  return {{"n", of_numbers(p.plane.normal.data(), 3)}, {"d", p.plane.offset},
          {"c", of_numbers(p.centroid.data(), 3)},     {"a", of_numbers(p.axis1.data(), 3)},
          {"b", of_numbers(p.axis2.data(), 3)},        {"s", of_numbers(p.covariance.data(), 9)}};
}

UncertainPlane plane_of(const json& from) {
  UncertainPlane out;
  fill(from.at("n"), &out.plane.normal);
  out.plane.offset = from.at("d");
  fill(from.at("c"), &out.centroid);
  fill(from.at("a"), &out.axis1);
  fill(from.at("b"), &out.axis2);
  fill(from.at("s"), &out.covariance);
  return out;
}

json of_vehicle(const VehicleEstimate& v) {
  json keypoints = json::array();
  for (const Eigen::Vector3d& k : v.keypoints) keypoints.push_back(of_numbers(k.data(), 3));
  const Dimensions& d = v.pose.dimensions;
  return {{"id", v.id},
          {"class", v.vehicle_class},
          {"track", v.track},
          {"box", {v.box.x1, v.box.y1, v.box.x2, v.box.y2}},
          {"status", static_cast<int>(v.status)},
          {"reason", v.reason},
          {"pose", of_pose(v.pose.camera_from_vehicle)},
          {"size", {d.length, d.width, d.height}},
          {"keypoints", std::move(keypoints)},
          {"plane", {v.plane.normal.x(), v.plane.normal.y(), v.plane.normal.z(), v.plane.offset}},
          {"plane_sigma", v.plane_sigma_height},
          {"plane_source", v.plane_source},
          {"shape", v.shape},
          {"covariance", of_numbers(v.covariance.data(), v.covariance.size())},
          {"rmse", v.reprojection_rmse_px}};
}

VehicleEstimate vehicle_of(const json& from) {
  VehicleEstimate v;
  v.id = from.at("id");
  v.vehicle_class = from.at("class");
  v.track = from.at("track");
  const auto box = from.at("box").get<std::array<double, 4>>();
  v.box = {box[0], box[1], box[2], box[3]};
  v.status = static_cast<Status>(from.at("status").get<int>());
  v.reason = from.at("reason");
  v.pose.camera_from_vehicle = pose_of(from.at("pose"));
  const auto size = from.at("size").get<std::array<double, 3>>();
  v.pose.dimensions = {size[0], size[1], size[2]};
  const json& keypoints = from.at("keypoints");
  for (std::size_t i = 0; i < v.keypoints.size(); ++i) fill(keypoints.at(i), &v.keypoints[i]);
  const auto plane = from.at("plane").get<std::array<double, 4>>();
  v.plane = {{plane[0], plane[1], plane[2]}, plane[3]};
  v.plane_sigma_height = from.at("plane_sigma");
  v.plane_source = from.at("plane_source");
  v.shape = from.at("shape").get<std::vector<double>>();
  fill(from.at("covariance"), &v.covariance);
  v.reprojection_rmse_px = from.at("rmse");
  return v;
}

/// 20 bytes a sample.
json of_road(const std::vector<RoadSample>& road) {
  std::vector<std::uint8_t> bytes(20 * road.size());
  std::uint8_t* to = bytes.data();
  for (const RoadSample& s : road) {
    std::memcpy(to, s.point.data(), 12);
    std::memcpy(to + 12, &s.sigma, 4);
    to[16] = s.label;
    std::copy(s.color.begin(), s.color.end(), to + 17);
    to += 20;
  }
  return json::binary(std::move(bytes));
}

std::vector<RoadSample> road_of(const json& from) {
  const auto& bytes = from.get_binary();
  std::vector<RoadSample> out(bytes.size() / 20);
  const std::uint8_t* at = bytes.data();
  for (RoadSample& s : out) {
    std::memcpy(s.point.data(), at, 12);
    std::memcpy(&s.sigma, at + 12, 4);
    s.label = at[16];
    std::copy(at + 17, at + 20, s.color.begin());
    at += 20;
  }
  return out;
}

}  // namespace

std::size_t WindowMeasurement::index_of_reference() const {
  return static_cast<std::size_t>(std::find(frames.begin(), frames.end(), reference) -
                                  frames.begin());
}

std::vector<std::uint8_t> encode(const WindowMeasurement& w) {
  json poses = json::array();
  for (const SE3& pose : w.frame_from_reference) poses.push_back(of_pose(pose));
  json vehicles = json::array();
  for (const VehicleFrame& frame : w.vehicles) {
    json estimates = json::array();
    for (const VehicleEstimate& v : frame.vehicles) estimates.push_back(of_vehicle(v));
    vehicles.push_back({{"id", frame.id}, {"vehicles", std::move(estimates)}});
  }
  json tracked = json::array();
  for (const auto& t : w.tracked) tracked.push_back({t.frame, t.id, t.track});
  json out = {{"reference", w.reference},
              {"frames", w.frames},
              {"poses", std::move(poses)},
              {"covariance", of_numbers(w.covariance.data(), w.covariance.size())},
              {"scale_sigma", w.scale_sigma},
              {"common", w.common_scale_sigma},
              {"metric", w.metric},
              {"reason", w.reason},
              {"road", of_road(w.road)},
              {"vehicles", std::move(vehicles)},
              {"tracked", std::move(tracked)}};
  if (w.log_scale) out["log_scale"] = *w.log_scale;
  if (w.ego) out["ego"] = of_plane(*w.ego);
  return json::to_cbor(out);
}

WindowMeasurement decode_window(const std::vector<std::uint8_t>& bytes) {
  try {
    const json from = json::from_cbor(bytes);
    WindowMeasurement w;
    w.reference = from.at("reference");
    w.frames = from.at("frames").get<std::vector<int>>();
    for (const json& pose : from.at("poses")) w.frame_from_reference.push_back(pose_of(pose));
    const auto others =
        static_cast<Eigen::Index>(std::max<std::size_t>(w.frame_from_reference.size(), 1) - 1);
    w.covariance.resize(6 * others, 6 * others);
    fill(from.at("covariance"), &w.covariance);
    w.scale_sigma = from.at("scale_sigma");
    w.common_scale_sigma = from.at("common");
    w.metric = from.at("metric");
    w.reason = from.at("reason");
    w.road = road_of(from.at("road"));
    for (const json& frame : from.at("vehicles")) {
      VehicleFrame& to = w.vehicles.emplace_back();
      to.id = frame.at("id");
      for (const json& v : frame.at("vehicles")) to.vehicles.push_back(vehicle_of(v));
    }
    for (const json& t : from.at("tracked")) w.tracked.push_back({t.at(0), t.at(1), t.at(2)});
    if (from.contains("log_scale")) w.log_scale = from.at("log_scale").get<double>();
    if (from.contains("ego")) w.ego = plane_of(from.at("ego"));
    return w;
  } catch (const json::exception& error) {
    throw std::invalid_argument(std::string("a drive window: ") + error.what());
  }
}

}  // namespace camber
