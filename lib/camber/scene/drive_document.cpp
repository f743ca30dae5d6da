#include "camber/scene/drive_document.h"

#include <cmath>

#include "camber/core/errors.h"
#include "camber/scene/json_reader.h"

namespace camber {
namespace {

using nlohmann::json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMost = 1e12;  // of lengths, angles and times that can be used
constexpr int kMaxId = 2000000000;
constexpr char kStatusWords[] = "\"ok\", \"weak\", \"not_observable\", \"failed\" or \"not_run\"";

struct NamedNumber {
  const char* name;
  const char* sigma_name;
  DriveNumber DriveFrame::*of;
};

constexpr NamedNumber kFrameNumbers[] = {{"s", "s_sigma", &DriveFrame::s},
                                         {"height", "height_sigma", &DriveFrame::height},
                                         {"pitch", "pitch_sigma", &DriveFrame::pitch},
                                         {"roll", "roll_sigma", &DriveFrame::roll},
                                         {"speed", "speed_sigma", &DriveFrame::speed},
                                         {"grade", "grade_sigma", &DriveFrame::grade},
                                         {"bank", "bank_sigma", &DriveFrame::bank}};

double find_number(JsonObject& object, const char* key) {
  const auto value = object.find(key);
  return value ? value->in_range(-kMost, kMost, "a number within 1e12 of 0, or null") : kNaN;
}

double find_sigma(JsonObject& object, const char* key) {
  const auto value = object.find(key);
  return value ? value->in_range(0.0, kMost, "a standard deviation of at least 0, or null") : kNaN;
}

DriveNumber find_pair(JsonObject& object, const char* key, const char* sigma_key) {
  return {find_number(object, key), find_sigma(object, sigma_key)};
}

void add_pair(json& out, const char* key, const char* sigma_key, const DriveNumber& number) {
  out[key] = number_json(number.value);
  out[sigma_key] = number_json(number.sigma);
}

DriveFrame read_frame(const JsonCursor& cursor) {
  JsonObject object(cursor, "a frame {\"id\", \"world_from_camera\", ...}");
  DriveFrame out;
  out.id = object.require("id", "a frame id").integer(0, kMaxId, "a frame id");
  out.time_s = find_number(object, "time_s");
  if (const auto v = object.find("world_from_camera")) {
    out.world_from_camera = v->pose();
    if (!(out.world_from_camera->translation().cwiseAbs().maxCoeff() < kMost)) {
      v->fail("a translation within 1e12 m");
    }
  }
  if (const auto v = object.find("covariance")) {
    const std::vector<double> c = v->numbers(36, "36 numbers, or null");
    out.covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(c.data());
  }
  for (const NamedNumber& number : kFrameNumbers) {
    out.*number.of = find_pair(object, number.name, number.sigma_name);
  }
  if (const auto v = object.find("status")) {
    try {
      out.status = status_from_string(v->text(kStatusWords));
    } catch (const std::invalid_argument&) {
      v->fail(kStatusWords);
    }
  }
  if (const auto v = object.find("reason")) out.reason = v->text();
  return out;
}

}  // namespace

json to_json(const DriveDocument& document) {
  json windows = json::array(), frames = json::array();
  for (const DriveWindow& window : document.windows) {
    windows.push_back({{"first", window.first},
                       {"last", window.last},
                       {"length", number_json(window.length)},
                       {"length_sigma", number_json(window.length_sigma)}});
  }
  for (const DriveFrame& frame : document.frames) {
    json one = {{"id", frame.id},
                {"time_s", number_json(frame.time_s)},
                {"status", to_string(frame.status)},
                {"reason", frame.reason}};
    one["world_from_camera"] =
        frame.world_from_camera ? matrix_json(frame.world_from_camera->matrix()) : json(nullptr);
    one["covariance"] = nullptr;
    if (frame.covariance) {
      json numbers = json::array();
      for (int i = 0; i < 36; ++i) {
        numbers.push_back(number_json((*frame.covariance)(i / 6, i % 6)));
      }
      one["covariance"] = std::move(numbers);
    }
    for (const NamedNumber& number : kFrameNumbers) {
      add_pair(one, number.name, number.sigma_name, frame.*number.of);
    }
    frames.push_back(std::move(one));
  }
  json camera = json::object();
  add_pair(camera, "pitch", "pitch_sigma", document.pitch);
  add_pair(camera, "roll", "roll_sigma", document.roll);
  add_pair(camera, "height", "height_sigma", document.height);
  json out = {{"metric", document.metric},
              {"length", number_json(document.length)},
              {"length_sigma", number_json(document.length_sigma)},
              {"common_sigma", number_json(document.common_sigma)},
              {"camera", std::move(camera)},
              {"windows", std::move(windows)},
              {"frames", std::move(frames)}};
  if (document.positions) {
    const DrivePositions& p = *document.positions;
    out["positions"] = {{"frames", p.frames},
                        {"log_scale", number_json(p.log_scale)},
                        {"sigma", number_json(p.sigma)},
                        {"disagreement_sigmas", number_json(p.disagreement_sigmas)}};
  }
  return out;
}

DriveDocument read_drive(const std::filesystem::path& path) {
  const json document = parse_json(read_whole_file(path), path.string());
  JsonContext context;
  context.file = path.string();
  JsonObject root(JsonCursor(document, context), "a drive {\"metric\", \"length\", \"frames\"}");
  DriveDocument out;
  if (const auto v = root.find("metric")) out.metric = v->boolean();
  out.length = find_number(root, "length");
  out.length_sigma = find_sigma(root, "length_sigma");
  out.common_sigma = find_sigma(root, "common_sigma");
  if (const auto v = root.find("camera")) {
    JsonObject camera(*v, "the camera's mounting {\"pitch\", \"roll\", \"height\"}");
    out.pitch = find_pair(camera, "pitch", "pitch_sigma");
    out.roll = find_pair(camera, "roll", "roll_sigma");
    out.height = find_pair(camera, "height", "height_sigma");
  }
  if (const auto v = root.find("positions")) {
    JsonObject positions(*v, "positions on a map {\"frames\", \"log_scale\", \"sigma\"}");
    DrivePositions p;
    if (const auto n = positions.find("frames")) p.frames = n->integer(0, kMaxId, "a number");
    p.log_scale = find_number(positions, "log_scale");
    p.sigma = find_sigma(positions, "sigma");
    p.disagreement_sigmas = find_sigma(positions, "disagreement_sigmas");
    out.positions = p;
  }
  for (const JsonCursor& item :
       root.require("frames", "an array of frames").items("an array of frames")) {
    DriveFrame frame = read_frame(item);
    if (!out.frames.empty() && frame.id <= out.frames.back().id) {
      item.fail_because("found frame " + std::to_string(frame.id) + " after frame " +
                        std::to_string(out.frames.back().id) + ", expected ascending ids");
    }
    out.frames.push_back(std::move(frame));
  }
  if (const auto v = root.find("windows")) {
    for (const JsonCursor& item : v->items("an array of windows")) {
      JsonObject window(item, "a window {\"first\", \"last\", \"length\", \"length_sigma\"}");
      DriveWindow one;
      one.first = window.require("first", "a frame id").integer(0, kMaxId, "a frame id");
      const JsonCursor last = window.require("last", "a frame id");
      one.last = last.integer(0, kMaxId, "a frame id");
      if (one.last < one.first) last.fail("a frame id of at least that of first");
      one.length = find_number(window, "length");
      one.length_sigma = find_sigma(window, "length_sigma");
      out.windows.push_back(one);
    }
  }
  return out;
}

}  // namespace camber
