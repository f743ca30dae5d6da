#include "camber/pipeline/detect_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <opencv2/core/version.hpp>

#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/read_file.h"
#include "camber/core/threads.h"
#include "camber/core/version.h"
#include "camber/detect/shipped_networks.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/image/video.h"
#include "camber/pipeline/network_file.h"
#include "camber/pipeline/recognise_detector.h"
#include "camber/vehicle/vehicle_noise.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Change it with anything that alters what is made of a network's outputs.
constexpr int kResultVersion = 1;

std::string source_of(const NetworkUse& use) {
  return (use.file == kShippedNetwork ? "shipped:" : "network:") + use.hash;
}

/// Where a network and its description are.
struct NetworkPlace {
  std::string name, hash, side_hash;  ///< as given; of both files' content
  std::function<OnnxFile()> read;
};

NetworkPlace place_of(const fs::path& file, const fs::path& side_file) {
  return {file.string(), hash_file(file), hash_file(side_file),
          [file] { return read_onnx_file(file); }};
}

/// A network with its description, loaded when an image is not in the cache.
template <typename Net, typename Description>
class LazyNetwork {
 public:
  LazyNetwork(const NetworkPlace& place, Description description, const DetectionCache& cache)
      : read_(place.read), description_(std::move(description)), cache_(cache) {
    use.file = place.name;
    use.hash = place.hash;
    use.name = description_.name;
    key_ = hash_bytes(fmt::format("{} {} {} {} {}", kResultVersion, kVersion, CV_VERSION, use.hash,
                                  place.side_hash));
    const auto layers = cache.find_word(key_);
    if (layers) use.layers = *layers;
  }

  const Description& description() const { return description_; }

  const Net& get() {
    if (!network_) {
      network_ = std::make_unique<Net>(read_(), description_);
      use.layers = network_->network().layers();
      cache_.put_word(key_, use.layers);
    }
    return *network_;
  }

  /// Key of an image's result.
  std::string key(const Image& image) const {
    const std::string pixels =
        hash_bytes({reinterpret_cast<const char*>(image.data.data()), image.data.size()});
    return hash_bytes(fmt::format("{} {} {} {}", key_, image.width, image.height, pixels));
  }
  /// Whether what the cache has may be used: the network was checked when it was loaded.
  bool known() const { return !use.layers.empty(); }

  NetworkUse use;

 private:
  std::function<OnnxFile()> read_;
  Description description_;
  const DetectionCache& cache_;
  std::string key_;
  std::unique_ptr<Net> network_;
};

using LazyDetector = LazyNetwork<Detector, DetectorDescription>;
using LazySegmenter = LazyNetwork<Segmenter, SegmenterDescription>;

/// One frame's images and what was found in them.
struct FrameWork {
  int id = 0;
  Image raw, undistorted;  // the second empty if it is the same
  std::string boxes_key, labels_key;
  std::optional<std::vector<DetectedVehicle>> boxes;
  std::optional<Image> labels;
  bool new_labels = false;
  std::vector<ImagePart> parts;
  std::vector<std::vector<DetectedVehicle>> by_part;

  const Image& pinhole() const { return undistorted.empty() ? raw : undistorted; }
};

class FrameRunner {
 public:
  FrameRunner(const Scene& scene, const DetectFramesOptions& options, const LogSink& warn)
      : scene_(scene),
        options_(options),
        cache_(options.cache),
        lens_(scene.camera, scene.distortion) {
    const NetworkFiles& files = options.networks;
    if (files.detector_ships()) {
      const std::string text = shipped_detector_description();
      const NetworkPlace place = {kShippedNetwork, hash_bytes(shipped_detector().bytes),
                                  hash_bytes(text), shipped_detector};
      detector_.emplace(place, parse_detector_description(text, kShippedNetwork), cache_);
    } else if (!files.detector.empty()) {
      const fs::path side = side_file_of(files.detector, files.detector_config);
      std::error_code ignored;
      if (files.detector_config.empty() && !fs::exists(side, ignored)) {
        put_recognised(files.detector, side, warn);
      } else {
        detector_.emplace(place_of(files.detector, side), read_detector_description(side, warn),
                          cache_);
      }
    }
    if (!files.segmenter.empty()) {
      const fs::path side = side_file_of(files.segmenter, files.segmenter_config);
      segmenter_.emplace(place_of(files.segmenter, side), read_segmenter_description(side, warn),
                         cache_);
    }
  }

  /// Reads a frame's image and looks into the cache.
  FrameWork start(int id) {
    const SceneFrame* frame = scene_.find_frame(id);
    if (!frame) throw std::invalid_argument(fmt::format("the scene has no frame {}", id));
    FramePixels held = options_.pixels ? options_.pixels(id) : FramePixels();
    if (held.image.empty() && frame->image.empty()) {
      throw NoAnswerError(
          fmt::format("frame {} has no image in the manifest; networks need images", id));
    }
    FrameWork work;
    work.id = id;
    work.raw = held.image.empty()
                   ? reader_.read(frame->image, lens_.raw()).color
                   : make_frame_image(std::move(held.image), Undistortion(lens_.raw()), id).color;
    if (lens_.needed()) work.undistorted = lens_.image(work.raw);
    if (detector_) {
      work.boxes_key = detector_->key(work.pinhole());
      if (detector_->known()) work.boxes = cache_.find_boxes(work.boxes_key);
      ++(work.boxes ? detector_->use.cached : detector_->use.computed);
    }
    if (segmenter_) {
      work.labels_key = segmenter_->key(work.raw);
      if (segmenter_->known()) {
        work.labels = cache_.find_labels(work.labels_key, work.raw.width, work.raw.height);
      }
      ++(work.labels ? segmenter_->use.cached : segmenter_->use.computed);
    }
    return work;
  }

  /// Computes what the cache does not have of several frames, side by side.
  void compute(std::vector<FrameWork>& frames) {
    std::vector<std::function<void()>> jobs;
    for (FrameWork& work : frames) {
      if (segmenter_ && !work.labels) {
        const Segmenter& segmenter = segmenter_->get();
        work.new_labels = true;
        jobs.emplace_back([&work, &segmenter] { work.labels = segmenter.segment(work.raw); });
      }
      if (!detector_ || work.boxes) continue;
      const Detector& detector = detector_->get();
      work.parts = detector.parts(work.pinhole());
      work.by_part.resize(work.parts.size());
      for (std::size_t i = 0; i < work.parts.size(); ++i) {
        jobs.emplace_back([&work, &detector, i] {
          work.by_part[i] = detector.look_at(work.pinhole(), work.parts[i]);
        });
      }
    }
    {
      const SingleThreadedOpenCv one_thread;
      parallel_for(jobs.size(), options_.num_threads, [&](std::size_t i) { jobs[i](); });
    }
    for (FrameWork& work : frames) {
      if (work.new_labels) cache_.put_labels(work.labels_key, *work.labels);
      if (work.by_part.empty()) continue;
      work.boxes = detector_->get().merge(work.by_part);
      cache_.put_boxes(work.boxes_key, *work.boxes);
    }
  }

  std::optional<LazyDetector>& detector() { return detector_; }
  std::optional<LazySegmenter>& segmenter() { return segmenter_; }

 private:
  /// A detector without a description.
  void put_recognised(const fs::path& file, const fs::path& side, const LogSink& warn) {
    RecognisedDetector recognised = recognise_detector(read_onnx_file(file));
    if (!recognised.description) {
      throw InputError(side.string(),
                       fmt::format("no such file, expected the description of the detector (see "
                                   "docs/formats.md, side files of networks): of {} itself {}",
                                   file.filename().string(), recognised.reason));
    }
    if (warn) warn(fmt::format("{}: {}", file.string(), recognised.reason));
    const NetworkPlace place = {file.string(), hash_file(file), hash_bytes(recognised.reason),
                                [file] { return read_onnx_file(file); }};
    detector_.emplace(place, std::move(*recognised.description), cache_);
  }

  const Scene& scene_;
  const DetectFramesOptions& options_;
  DetectionCache cache_;
  Undistortion lens_;
  FrameImageReader reader_;
  std::optional<LazyDetector> detector_;
  std::optional<LazySegmenter> segmenter_;
};

std::vector<VehicleDetection> detections_of(const std::vector<DetectedVehicle>& boxes) {
  std::vector<VehicleDetection> out;
  for (const DetectedVehicle& box : boxes) {
    VehicleDetection detection;
    detection.id = static_cast<int>(out.size());
    detection.vehicle_class = box.vehicle_class;
    detection.box = box.box;
    detection.score = box.score;
    out.push_back(std::move(detection));
  }
  return out;
}

bool has_masks(const Scene& scene, const std::vector<int>& frame_ids) {
  return std::any_of(frame_ids.begin(), frame_ids.end(), [&](int id) {
    const SceneFrame* frame = scene.find_frame(id);
    return frame && !(frame->segmentation.empty() && frame->road_mask.empty());
  });
}

}  // namespace

bool NetworkFiles::detector_ships() const {
  return detector == kShippedNetwork && detector_config.empty();
}

NetworkView detect_frames(const Scene& scene, const std::vector<int>& frame_ids,
                          const DetectFramesOptions& options, const Progress& progress,
                          const LogSink& warn) {
  FrameRunner runner(scene, options, warn);
  NetworkView out;
  // So many at a time that all threads have work, and few images are held.
  const auto batch = static_cast<std::size_t>(resolve_num_threads(options.num_threads));
  for (std::size_t first = 0; first < frame_ids.size(); first += batch) {
    if (progress) progress("networks", static_cast<double>(first) / frame_ids.size());
    std::vector<FrameWork> frames;
    for (std::size_t k = first; k < std::min(first + batch, frame_ids.size()); ++k) {
      frames.push_back(runner.start(frame_ids[k]));
    }
    runner.compute(frames);
    for (FrameWork& work : frames) {
      if (work.boxes) out.vehicles[work.id] = detections_of(*work.boxes);
      if (work.labels) out.labels[work.id] = std::move(*work.labels);
    }
  }
  if (const auto& detector = runner.detector()) {
    out.detector = detector->use;
    out.box_sigma_px =
        detector->description().box_sigma_px.value_or(BoxNoise().network_pixel_sigma);
  }
  if (const auto& segmenter = runner.segmenter()) {
    out.segmenter = segmenter->use;
    out.classes = segmenter->description().classes;
  }
  if (progress) progress("networks", 1.0);
  return out;
}

bool has_boxes(const Scene& scene) {
  return std::any_of(scene.frames.begin(), scene.frames.end(),
                     [](const SceneFrame& frame) { return !frame.vehicles.empty(); });
}

bool has_images(const Scene& scene, const std::vector<int>& frame_ids,
                const FramePixelSource& pixels) {
  return std::all_of(frame_ids.begin(), frame_ids.end(), [&](int id) {
    const SceneFrame* frame = scene.find_frame(id);
    return frame && (!frame->image.empty() || (pixels && !pixels(id).image.empty()));
  });
}

void put_network_view(const NetworkView& view, Scene* scene) {
  if (view.detector) {
    for (SceneFrame& frame : scene->frames) {
      const auto found = view.vehicles.find(frame.id);
      frame.vehicles =
          found == view.vehicles.end() ? std::vector<VehicleDetection>() : found->second;
    }
    scene->detections_source = source_of(*view.detector);
    scene->box_sigma_px = view.box_sigma_px;
  }
  if (view.segmenter) {
    scene->segmentation_classes.clear();
    scene->segmentation_classes["road"] = {kRoadLabel};
    if (!view.classes->pavement.empty()) {
      scene->segmentation_classes["pavement"] = {kPavementLabel};
    }
    if (!view.classes->vehicle.empty()) scene->segmentation_classes["vehicle"] = {kVehicleLabel};
    scene->segmentation_source = source_of(*view.segmenter);
  }
}

std::optional<NetworkUse> mask_vehicles(const Scene& scene, const std::vector<int>& frame_ids,
                                        DetectFramesOptions options, stages::LoadOptions* load,
                                        const Progress& progress) {
  load->vehicle_boxes.clear();
  if (!load->labels.empty() || has_boxes(scene)) return std::nullopt;
  if (load->use_masks && has_masks(scene, frame_ids)) return std::nullopt;
  if (!has_images(scene, frame_ids, options.pixels)) {
    return std::nullopt;  // load() names what lacks one
  }
  options.networks = {};
  options.networks.detector = kShippedNetwork;
  const NetworkView view = detect_frames(scene, frame_ids, options, progress);
  // What hides the road should be a vehicle.
  for (const auto& [id, vehicles] : view.vehicles) {
    std::vector<Box2>& boxes = load->vehicle_boxes[id];
    for (const VehicleDetection& vehicle : vehicles) {
      if (vehicle.score >= kSureScore) boxes.push_back(vehicle.box);
    }
  }
  return view.detector;
}

}  // namespace camber
