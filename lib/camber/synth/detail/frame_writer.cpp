#include "camber/synth/detail/frame_writer.h"

#include <fmt/format.h>

#include <cmath>

#include "camber/core/atomic_file.h"
#include "camber/image/image_io.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Metres * 256 in 16 bits, 0 for the sky and beyond 255.9 m.
std::vector<std::uint16_t> kitti_depth(const ViewTruth& truth) {
  std::vector<std::uint16_t> out;
  out.reserve(truth.hits.size());
  for (const WorldHit& hit : truth.hits) {
    out.push_back(
        hit.distance < 255.9 ? static_cast<std::uint16_t>(std::lround(256.0 * hit.distance)) : 0);
  }
  return out;
}

/// Depth of a frame as a file of the layout.
std::string encode_depth(const ViewTruth& truth, int width, int height, SceneLayout layout) {
  if (layout == SceneLayout::kSynthiaSf) {
    return encode_png(synthia_depth_image(truth, width, height), PngCompression::kSmall);
  }
  return encode_png16(width, height, kitti_depth(truth));
}

/// Classes of a frame as a file of the layout.
std::string encode_labels(const ViewTruth& truth, int width, int height,
                          const DataSetLayout& layout) {
  if (layout.layout == SceneLayout::kSynthiaSf) {
    return encode_png(synthia_label_image(truth, width, height, layout.instance_ids));
  }
  return encode_png({width, height, 1, truth.labels});
}

}  // namespace

FrameWriter::FrameWriter(const SynthOptions& options, const ViewCamera& view,
                         const SynthWorld& world, const FramePlace& place, const fs::path& root,
                         SynthSummary* summary)
    : options_(options),
      view_(view),
      world_(world),
      place_(place),
      root_(root),
      summary_(summary),
      sensor_(options.sensor),
      detector_(options.detector) {
  sensor_.seed = options.seed + place.random;
  detector_.seed = options.seed + place.random;
}

void FrameWriter::write_truth(int f, SceneFrame* frame, TruthFrame* truth) {
  const StageTimer timer(summary_->timings, "truth");
  const int number = place_.first + f;
  const std::string file = fmt::format("{:06d}.png", number);
  const PinholeCamera &camera = view_.camera(), &file_camera = view_.file();
  const int width = camera.width, height = camera.height;
  const ViewTruth seen = trace_view(world_, f, camera, options_.num_threads);
  const SE3& world_from_camera = world_.views[f].world_from_camera;
  truth->id = number;
  truth->world_from_camera = place_.truth_from_world * world_from_camera;
  truth->ego_plane = world_.views[f].ego_plane.transformed(world_from_camera.inverse());
  truth->vehicles = true_vehicles(world_, f, view_, seen);
  const DataSetLayout& layout = options_.layout;
  const bool synthia = layout.layout == SceneLayout::kSynthiaSf;
  const fs::path labels = root_ / layout.label(number);
  write_file_atomically(labels, encode_labels(seen, width, height, layout));
  // The manifest's label images have one channel.
  if (!synthia) truth->label = labels;
  if (synthia || (place_.depth && (number == 0 || number == options_.num_frames - 1))) {
    truth->depth = root_ / layout.depth(number);
    truth->depth_encoding = synthia ? "synthia" : "kitti";
    write_file_atomically(truth->depth, encode_depth(seen, width, height, layout.layout));
  }
  frame->id = number;
  frame->time_s = number / options_.frame_rate;
  frame->segmentation = root_ / "segmentation" / file;
  frame->vehicles = simulate_detections(world_, f, view_, truth->vehicles, detector_);
  summary_->detections += static_cast<int>(frame->vehicles.size());
  std::vector<std::uint8_t> segmentation = simulate_segmentation(
      view_.has_lens() ? trace_labels(world_, f, view_, options_.num_threads) : seen.labels,
      file_camera.width, file_camera.height, options_.seed, number);
  write_file_atomically(frame->segmentation, encode_png({file_camera.width, file_camera.height, 1,
                                                         std::move(segmentation)}));
}

void FrameWriter::write_image(int f, SceneFrame* frame) {
  const StageTimer timer(summary_->timings, "render");
  frame->image = root_ / options_.layout.image(place_.first + f);
  std::vector<std::uint8_t> picture = render_view(world_, f, view_, sensor_, options_.num_threads);
  write_file_atomically(frame->image, encode_png({options_.camera.width, options_.camera.height, 3,
                                                  std::move(picture)}));
}

}  // namespace camber
