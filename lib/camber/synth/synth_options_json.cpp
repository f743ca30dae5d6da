#include <nlohmann/json.hpp>

#include "camber/synth/synthesise.h"

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

void put(nlohmann::json* out, const char* key, const std::optional<double>& value,
         double factor = 1.0) {
  if (value) (*out)[key] = factor * *value;
}

std::string_view name_of(TurnDirection turn) {
  return turn == TurnDirection::kLeft ? "left" : "right";
}

/// What was asked for; what is drawn from the seed is left out.
nlohmann::json features_json(const SceneFeatures& f) {
  nlohmann::json out = {
      {"asphalt", {{"texture", to_string(f.asphalt.texture)}, {"wetness", f.asphalt.wetness}}},
      {"roadside",
       {{"verge_rise", f.roadside.verge_rise}, {"verge_rise_width", f.roadside.verge_rise_width}}},
      {"mounting", {{"ahead_of_axle", f.mounting.ahead_of_axle}}},
      {"weather",
       {{"haze_distance", f.weather.haze_distance}, {"lights_on", f.weather.lights_on}}}};
  put(&out["asphalt"], "contrast", f.asphalt.contrast);
  nlohmann::json& roadside = out["roadside"];
  if (f.roadside.pavements) roadside["pavements"] = to_string(*f.roadside.pavements);
  put(&roadside, "kerb_height", f.roadside.kerb_height);
  put(&roadside, "edge_distance", f.roadside.edge_distance);
  put(&roadside, "half_width", f.roadside.half_width);
  put(&out["mounting"], "pitch_deg", f.mounting.pitch, kDegrees);
  put(&out["mounting"], "yaw_deg", f.mounting.yaw, kDegrees);
  put(&out["mounting"], "roll_deg", f.mounting.roll, kDegrees);
  put(&out["weather"], "cloudiness", f.weather.cloudiness);
  put(&out["weather"], "sun_elevation_deg", f.weather.sun_elevation, kDegrees);
  if (f.markings) out["markings"] = to_string(*f.markings);
  if (f.lead_car.enabled) out["lead_car"] = {{"gap", f.lead_car.gap}};
  if (f.bend.radius > 0.0) {
    out["bend"] = {{"radius", f.bend.radius}, {"turn", name_of(f.bend.turn)}};
  }
  if (f.corner.enabled) {
    out["corner"] = {
        {"kind", to_string(f.corner.kind)}, {"turn", name_of(f.corner.turn)},
        {"radius", f.corner.radius},        {"yaw_rate_deg", kDegrees * f.corner.yaw_rate},
        {"phase", f.corner.phase},          {"angle_deg", kDegrees * f.corner.angle},
        {"arm_grade", f.corner.arm_grade}};
  }
  return out;
}

}  // namespace

nlohmann::json options_json(const SynthOptions& o) {
  nlohmann::json out = {{"profile", to_string(o.profile)},
                        {"frames", o.num_frames},
                        {"frame_rate", o.frame_rate},
                        {"speed", o.speed},
                        {"camera",
                         {{"width", o.camera.width},
                          {"height", o.camera.height},
                          {"fx", o.camera.fx},
                          {"fy", o.camera.fy},
                          {"cx", o.camera.cx},
                          {"cy", o.camera.cy}}},
                        {"camera_height", o.camera_height},
                        {"cars", o.num_cars},
                        {"nearest_car", o.nearest_car},
                        {"farthest_car", o.farthest_car},
                        {"features", features_json(o.features)},
                        {"supersampling", o.sensor.supersampling},
                        {"blur", o.sensor.blur},
                        {"noise", o.sensor.noise},
                        {"exposure_change", o.sensor.exposure_change},
                        {"vignetting", o.sensor.vignetting},
                        {"keypoint_error", o.detector.keypoint_error},
                        {"outlier_share", o.detector.outlier_share},
                        {"miss_share", o.detector.miss_share},
                        {"false_boxes", o.detector.false_boxes},
                        {"cloud_points", o.cloud_points}};
  if (o.lens != LensModel::kNone) {
    out["distortion"] = {{"model", to_string(o.lens)}, {"coefficients", o.lens_coefficients}};
  }
  if (o.layout.layout != SceneLayout::kCamber) {
    out["layout"] = to_string(o.layout.layout);
    out["sequence"] = o.layout.sequence;
    if (o.layout.layout == SceneLayout::kSynthiaSf) out["instance_ids"] = o.layout.instance_ids;
  }
  return out;
}

}  // namespace camber
