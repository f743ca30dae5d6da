#include "scene.h"

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <stdexcept>

#include "camber/scene/validate_scene.h"
#include "running.h"

namespace camber::python {
namespace {

using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;

Image image_from(const py::object& value, const std::string& what) {
  if (!value || value.is_none()) return {};
  const bool asked = !py::isinstance<py::array>(value) && PyCallable_Check(value.ptr()) != 0;
  return to_image(asked ? py::object(value()) : value, what);
}

SE3 to_pose(const py::handle& value, const std::string& what) {
  const Numbers rows = Numbers::ensure(value);
  if (!rows || rows.ndim() != 2 || rows.shape(0) != 4 || rows.shape(1) != 4) {
    PyErr_Clear();
    throw std::invalid_argument(what + ": expected 4 x 4 numbers");
  }
  Eigen::Matrix4d matrix;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) matrix(r, c) = rows.at(r, c);
  }
  const Eigen::Matrix3d turn = matrix.topLeftCorner<3, 3>();
  const bool rotation = (turn * turn.transpose() - Eigen::Matrix3d::Identity()).norm() <= 1e-3 &&
                        turn.determinant() > 0.0;
  const bool rigid = (matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() <= 1e-9;
  if (!matrix.allFinite() || !rotation || !rigid) {
    throw std::invalid_argument(what + ": expected a rotation and a translation, last row 0 0 0 1");
  }
  return SE3::from_matrix(matrix);
}

VehicleDetection make_detection(const py::object& box, std::optional<int> id,
                                const std::string& vehicle_class, double score,
                                const py::object& keypoints, int track,
                                const std::optional<Plane>& plane) {
  if (id && *id < 0) {
    throw std::invalid_argument(fmt::format("id: found {}, expected at least 0", *id));
  }
  VehicleDetection out;
  out.id = id.value_or(-1);  // add_frame() gives it one
  out.vehicle_class = vehicle_class;
  out.score = score;
  out.track = track;
  if (py::isinstance<Box2>(box)) {
    out.box = box.cast<Box2>();
  } else {
    const Numbers sides = Numbers::ensure(box);
    if (!sides || sides.ndim() != 1 || sides.shape(0) != 4) {
      PyErr_Clear();
      throw std::invalid_argument("box: expected a Box2 or 4 numbers x1, y1, x2, y2");
    }
    out.box = {sides.at(0), sides.at(1), sides.at(2), sides.at(3)};
  }
  if (!(out.box.x1 < out.box.x2 && out.box.y1 < out.box.y2 && std::isfinite(out.box.area()))) {
    throw std::invalid_argument(
        fmt::format("box: found {}, {} to {}, {}, expected x1 < x2, y1 < y2", out.box.x1,
                    out.box.y1, out.box.x2, out.box.y2));
  }
  if (!keypoints.is_none()) {
    const Numbers rows = Numbers::ensure(keypoints);
    if (!rows || rows.ndim() != 2 || rows.shape(0) != kNumKeypoints || rows.shape(1) != 3) {
      PyErr_Clear();
      throw std::invalid_argument("keypoints: expected 36 x 3 numbers: u, v, confidence");
    }
    for (int k = 0; k < kNumKeypoints; ++k) {
      out.keypoints.push_back({{rows.at(k, 0), rows.at(k, 1)}, rows.at(k, 2)});
    }
  }
  out.has_plane = plane.has_value();
  if (plane) out.given_plane = *plane;
  return out;
}

void require_positive(double value, const char* name) {
  if (!(value > 0.0) || !std::isfinite(value)) {
    throw std::invalid_argument(fmt::format("{}: found {}, expected > 0", name, value));
  }
}

PythonScene make_scene(const PinholeCamera& camera, const py::list& images,
                       std::optional<double> height_above_road, double height_sigma,
                       std::optional<double> frame_rate, std::optional<int> reference_frame,
                       const std::string& detections_source, std::optional<double> box_sigma_px,
                       std::map<std::string, std::vector<int>> segmentation_classes,
                       std::map<std::string, double> markings_m, const std::string& lens,
                       const std::vector<double>& distortion,
                       const std::optional<PinholeCamera>& raw_camera, const std::string& name) {
  PythonScene out;
  Scene& scene = out.scene;
  scene.name = name;
  scene.camera = camera;
  scene.height_above_road = height_above_road;
  scene.height_sigma = height_sigma;
  scene.frame_rate = frame_rate;
  scene.reference_frame = reference_frame;
  scene.detections_source = detections_source;
  scene.box_sigma_px = box_sigma_px;
  scene.segmentation_classes = std::move(segmentation_classes);
  scene.markings_m = std::move(markings_m);
  if (lens != "none" && lens != "brown" && lens != "fisheye") {
    throw std::invalid_argument("lens: found '" + lens +
                                "', expected 'none', 'brown' or 'fisheye'");
  }
  if (lens == "none" && (!distortion.empty() || raw_camera)) {
    throw std::invalid_argument(
        "lens: found 'none' beside distortion or raw_camera, expected 'brown' or 'fisheye'");
  }
  if (lens != "none") {
    scene.distortion = {lens == "brown" ? LensModel::kBrown : LensModel::kFisheye, distortion,
                        raw_camera.value_or(camera)};
  }
  validate(scene);  // the reference frame may be one that add_frame() adds
  for (const auto& image : images) {
    SceneFrame frame;
    frame.id = static_cast<int>(scene.frames.size());
    out.pixels[frame.id].image = py::reinterpret_borrow<py::object>(image);
    scene.frames.push_back(frame);
  }
  return out;
}

/// A file's path for the frame, or the pixels that Python holds.
void take_pixels(const py::object& value, std::filesystem::path* file, py::object* held) {
  const bool is_path = py::isinstance<py::str>(value) || py::hasattr(value, "__fspath__");
  if (is_path) *file = value.cast<std::filesystem::path>();
  *held = is_path ? py::none() : value;
}

/// Gives those without an id the least ones that no other vehicle of the frame has.
void number_vehicles(std::vector<VehicleDetection>* vehicles) {
  std::set<int> taken;
  for (const VehicleDetection& vehicle : *vehicles) taken.insert(vehicle.id);
  int next = 0;
  for (VehicleDetection& vehicle : *vehicles) {
    if (vehicle.id >= 0) continue;
    while (taken.count(next) > 0) ++next;
    vehicle.id = next++;
  }
}

/// @throws py::error_already_set where warnings are errors.
void warn_of_unread_segmentation(const Scene& scene, const py::object& segmentation) {
  if (segmentation.is_none() || scene.segmentation_classes.count("road") > 0) return;
  const char* const text =
      "segmentation_classes: no 'road' is named, so segmentations cannot show the road";
  if (PyErr_WarnEx(PyExc_UserWarning, text, 1) != 0) throw py::error_already_set();
}

void add_frame(PythonScene& self, const py::object& image, std::optional<int> id,
               const py::object& segmentation, const py::object& road_mask,
               std::optional<double> time_s, std::vector<VehicleDetection> vehicles,
               const std::optional<Plane>& ego_plane, const py::object& world_from_camera,
               const std::optional<Eigen::Vector3d>& up, std::optional<double> up_sigma,
               std::optional<double> speed, std::optional<double> speed_sigma) {
  SceneFrame frame;
  const auto& before = self.scene.frames;
  frame.id = id.value_or(before.empty() ? 0 : before.back().id + 1);
  if (!before.empty() && frame.id <= before.back().id) {
    throw std::invalid_argument(fmt::format("id: found {}, expected more than {}, the last frame's",
                                            frame.id, before.back().id));
  }
  frame.time_s = time_s;
  number_vehicles(&vehicles);
  frame.vehicles = std::move(vehicles);
  frame.ego_plane = ego_plane;
  if (!world_from_camera.is_none()) {
    frame.world_from_camera = to_pose(world_from_camera, "world_from_camera");
  }
  if ((up_sigma && !up) || (speed_sigma && !speed)) {
    const char* const of = up_sigma && !up ? "up" : "speed";
    throw std::invalid_argument(fmt::format("{0}_sigma: found without {0}, expected both", of));
  }
  if (up) {
    require_positive(up->norm(), "the length of up");
    frame.up = up->normalized();
  }
  if (up_sigma) frame.up_sigma = *up_sigma;
  if (speed) {
    frame.speed = speed;
    frame.speed_sigma = speed_sigma.value_or(default_speed_sigma(*speed));
  }
  validate(frame);
  warn_of_unread_segmentation(self.scene, segmentation);
  PythonScene::Pixels pixels;
  take_pixels(image, &frame.image, &pixels.image);
  take_pixels(segmentation, &frame.segmentation, &pixels.segmentation);
  take_pixels(road_mask, &frame.road_mask, &pixels.road_mask);
  self.pixels[frame.id] = pixels;
  self.scene.frames.push_back(std::move(frame));
}

void bind_detections(py::module_& module) {
  py::class_<VehicleDetection>(module, "VehicleDetection", kDoc_VehicleDetection)
      .def(py::init(&make_detection), py::arg("box"), py::kw_only(), py::arg("id") = py::none(),
           py::arg("vehicle_class") = "car", py::arg("score") = 1.0,
           py::arg("keypoints") = py::none(), py::arg("track") = -1, py::arg("plane") = py::none(),
           "box: a Box2 or x1, y1, x2, y2 in px; keypoints: 36 x 3, u, v, confidence (NaN: none); "
           "plane: the ground under it, camera frame.")
      .CAMBER_FIELD(VehicleDetection, id)
      .CAMBER_FIELD(VehicleDetection, vehicle_class)
      .CAMBER_FIELD(VehicleDetection, track)
      .CAMBER_FIELD(VehicleDetection, box)
      .CAMBER_FIELD(VehicleDetection, score)
      .def_property_readonly(
          "keypoints",
          [](const VehicleDetection& v) {
            Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> rows(v.keypoints.size(), 3);
            for (std::size_t k = 0; k < v.keypoints.size(); ++k) {
              rows.row(static_cast<Eigen::Index>(k)) << v.keypoints[k].pixel.x(),
                  v.keypoints[k].pixel.y(), v.keypoints[k].confidence;
            }
            return rows;
          },
          "36 x 3: u, v, confidence; or no rows")
      .def("__repr__", [](const VehicleDetection& v) {
        return fmt::format("<camber.VehicleDetection {} {}: {:.1f}, {:.1f} to {:.1f}, {:.1f} px>",
                           v.vehicle_class, v.id, v.box.x1, v.box.y1, v.box.x2, v.box.y2);
      });
  py::class_<MapPosition>(module, "MapPosition",
                          "Where a receiver's antenna was, on the map of Scene.map_crs.")
      .CAMBER_FIELD(MapPosition, position)
      .CAMBER_FIELD(MapPosition, sigma)
      .CAMBER_FIELD(MapPosition, height_sigma)
      .CAMBER_FIELD(MapPosition, heading)
      .CAMBER_FIELD(MapPosition, heading_sigma);
  py::class_<SceneFrame>(module, "SceneFrame", "One image of a scene with what is known about it.")
      .CAMBER_FIELD(SceneFrame, id)
      .CAMBER_FIELD(SceneFrame, time_s)
      .CAMBER_FIELD(SceneFrame, image)
      .CAMBER_FIELD(SceneFrame, segmentation)
      .CAMBER_FIELD(SceneFrame, road_mask)
      .CAMBER_FIELD(SceneFrame, ego_plane)
      .def_property_readonly(
          "world_from_camera",
          [](const SceneFrame& f) -> std::optional<Eigen::Matrix4d> {
            if (!f.world_from_camera) return std::nullopt;
            return to_matrix(*f.world_from_camera);
          },
          CAMBER_DOC(SceneFrame, world_from_camera))
      .CAMBER_FIELD(SceneFrame, up)
      .CAMBER_FIELD(SceneFrame, up_sigma)
      .CAMBER_FIELD(SceneFrame, speed)
      .CAMBER_FIELD(SceneFrame, speed_sigma)
      .CAMBER_FIELD(SceneFrame, map_position)
      .CAMBER_FIELD(SceneFrame, vehicles)
      .def("__repr__", [](const SceneFrame& f) {
        return fmt::format("<camber.SceneFrame {} with {} vehicles{}{}>", f.id, f.vehicles.size(),
                           f.image.empty() ? "" : ", ", f.image.string());
      });
}

/// The constructor's keywords, in its order.
std::string scene_doc() {
  return with_keywords(
      "A scene of images in memory: frames 0, 1, 2, ... of the images given, or those of "
      "add_frame(). An image is a uint8 array, height x width (x 3: red, green, blue), or a "
      "function that gives one when it is needed.",
      {{"height_above_road", CAMBER_DOC(Scene, height_above_road)},
       {"height_sigma", CAMBER_DOC(Scene, height_sigma)},
       {"frame_rate", CAMBER_DOC(Scene, frame_rate)},
       {"reference_frame", CAMBER_DOC(Scene, reference_frame)},
       {"detections_source", CAMBER_DOC(Scene, detections_source)},
       {"box_sigma_px", CAMBER_DOC(Scene, box_sigma_px)},
       {"segmentation_classes", "label values by class: {'road': [7], 'pavement': [8]}"},
       {"markings_m", "sizes of painted markings, m: {'dash_length': 3.0, ...}"},
       {"lens", "'brown' or 'fisheye': the images have its distortion"},
       {"distortion", CAMBER_DOC(LensDistortion, coefficients)},
       {"raw_camera", CAMBER_DOC(LensDistortion, raw)}});
}

}  // namespace

FramePixelSource PythonScene::source() const {
  if (pixels.empty()) return {};
  return [this](int id) -> FramePixels {
    const py::gil_scoped_acquire lock;
    const auto found = pixels.find(id);
    if (found == pixels.end()) return {};
    const std::string of = " of frame " + std::to_string(id);
    return {image_from(found->second.image, "image" + of),
            image_from(found->second.segmentation, "segmentation" + of),
            image_from(found->second.road_mask, "road_mask" + of)};
  };
}

void bind_scenes(py::module_& module) {
  bind_detections(module);
  const Scene defaults;
  py::class_<PythonScene>(module, "Scene",
                          "Frames of one moving camera with what is known of them.")
      .def(py::init(&make_scene), py::arg("camera"), py::arg("images") = py::list(), py::kw_only(),
           py::arg("height_above_road") = py::none(),
           py::arg("height_sigma") = defaults.height_sigma, py::arg("frame_rate") = py::none(),
           py::arg("reference_frame") = py::none(), py::arg("detections_source") = "",
           py::arg("box_sigma_px") = py::none(),
           py::arg("segmentation_classes") = std::map<std::string, std::vector<int>>(),
           py::arg("markings_m") = std::map<std::string, double>(), py::arg("lens") = "none",
           py::arg("distortion") = std::vector<double>(), py::arg("raw_camera") = py::none(),
           py::arg("name") = "", scene_doc().c_str())
      .def("add_frame", &add_frame, py::arg("image") = py::none(), py::kw_only(),
           py::arg("id") = py::none(), py::arg("segmentation") = py::none(),
           py::arg("road_mask") = py::none(), py::arg("time_s") = py::none(),
           py::arg("vehicles") = std::vector<VehicleDetection>(), py::arg("ego_plane") = py::none(),
           py::arg("world_from_camera") = py::none(), py::arg("up") = py::none(),
           py::arg("up_sigma") = py::none(), py::arg("speed") = py::none(),
           py::arg("speed_sigma") = py::none(),
           "Adds a frame behind the last one. image, segmentation and road_mask: uint8 arrays, "
           "functions that give one, or paths; up: gravity's up in the camera's frame; speed in "
           "m/s; world_from_camera: a known pose, 4 x 4.")
      .def_property_readonly("name", [](const PythonScene& s) { return s.scene.name; })
      .def_property_readonly("camera", [](const PythonScene& s) { return s.scene.camera; })
      .def_property(
          "height_above_road", [](const PythonScene& s) { return s.scene.height_above_road; },
          [](PythonScene& s, std::optional<double> height) {
            if (height) require_positive(*height, "height_above_road");
            s.scene.height_above_road = height;
          },
          CAMBER_DOC(Scene, height_above_road))
      .def_property_readonly(
          "frame_rate", [](const PythonScene& s) { return s.scene.frame_rate; },
          CAMBER_DOC(Scene, frame_rate))
      .def_property_readonly(
          "map_crs", [](const PythonScene& s) { return s.scene.map_crs; },
          CAMBER_DOC(Scene, map_crs))
      .def_property_readonly(
          "segmentation_classes", [](const PythonScene& s) { return s.scene.segmentation_classes; },
          CAMBER_DOC(Scene, segmentation_classes))
      .def_property_readonly(
          "frames", [](const PythonScene& s) { return s.scene.frames; },
          "ids ascending; copies: add_frame() adds one")
      .def("__len__", [](const PythonScene& s) { return s.scene.frames.size(); })
      .def("__repr__", [](const PythonScene& s) {
        return fmt::format(
            "<camber.Scene {}{} frames of {} x {} px{}>",
            s.scene.name.empty() ? "" : s.scene.name + ": ", s.scene.frames.size(),
            s.scene.camera.width, s.scene.camera.height,
            s.scene.height_above_road
                ? fmt::format(", camera {:.2f} m above the road", *s.scene.height_above_road)
                : ", camera height unknown");
      });
  module.def(
      "read_scene",
      [](const std::filesystem::path& path) {
        PythonScene out;
        out.scene = read_scene(path, python_warnings());
        out.path = std::filesystem::absolute(path).lexically_normal().string();
        return out;
      },
      py::arg("path"), kDoc_read_scene);
}

}  // namespace camber::python
