#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/image/still_share.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/pipeline/small_images.h"

namespace camber {
namespace {

/// The reference and what can stand beside it.
struct Reference {
  std::vector<std::size_t> places;  // in the scene
  std::vector<int> ids;             // of these
  std::size_t at = 0;

  /// The frames at some places, in their order; the reference is among them.
  Reference(const Scene& scene, std::vector<std::size_t> frames, std::size_t reference)
      : places(std::move(frames)) {
    for (const std::size_t place : places) ids.push_back(scene.frames[place].id);
    at = static_cast<std::size_t>(std::find(places.begin(), places.end(), reference) -
                                  places.begin());
  }

  explicit Reference(const Scene& scene) {
    const std::size_t count = scene.frames.size();
    if (count < 2) {
      throw NoAnswerError("one frame alone has no parallax: at least 2 frames are needed, " +
                          std::to_string(count) + " given");
    }
    for (std::size_t i = 0; i < count; ++i) {
      places.push_back(i);
      ids.push_back(scene.frames[i].id);
    }
    const int id = choose_reference_frame(scene, ids);
    at = static_cast<std::size_t>(std::find(ids.begin(), ids.end(), id) - ids.begin());
  }
  std::size_t behind() const { return at; }
  std::size_t ahead() const { return ids.size() - 1 - at; }

  /// The frame `spacing` away on each side and, for two a side, the one half as far; where there is
  /// none between, the one twice as far.
  std::vector<int> ids_with_spacing(std::size_t spacing, int each_side) const {
    std::vector<std::size_t> away = {spacing};
    if (each_side == 2) away.push_back(spacing == 1 ? 2 : (spacing + 1) / 2);
    std::vector<int> out = {ids[at]};
    for (const std::size_t n : away) {
      if (n <= behind()) out.push_back(ids[at - n]);
      if (n <= ahead()) out.push_back(ids[at + n]);
    }
    std::sort(out.begin(), out.end());
    return out;
  }

  ChosenFrames with_spacing(std::size_t spacing, int each_side) const {
    ChosenFrames out;
    out.spacing = static_cast<int>(spacing);
    out.ids = ids_with_spacing(spacing, each_side);
    for (const std::size_t fewer : {spacing, std::size_t{1}}) {
      std::vector<int> instead = ids_with_spacing(fewer, 1);
      if (instead != out.ids && (out.instead.empty() || instead != out.instead.back())) {
        out.instead.push_back(std::move(instead));
      }
    }
    return out;
  }
};

/// Whether two of some frames have the same image, as films have that were made of fewer pictures.
bool has_copies(const Scene& scene, const std::vector<int>& ids, SmallImages& images) {
  std::vector<std::vector<std::uint8_t>> seen;
  for (std::size_t place = 0; place < scene.frames.size(); ++place) {
    if (std::find(ids.begin(), ids.end(), scene.frames[place].id) == ids.end()) continue;
    seen.push_back(images.read(place).pixels);
    if (std::count(seen.begin(), seen.end(), seen.back()) > 1) return true;
  }
  return false;
}

/// The frames around the reference without those whose image is that of the one before.
/// @throws NoAnswerError where they all have one image.
Reference without_copies(const Scene& scene, const Reference& all, SmallImages& images) {
  constexpr std::size_t kReach = 150;  // frames on each side
  const std::size_t first = all.at - std::min(all.at, kReach);
  const std::size_t last = std::min(all.places.size() - 1, all.at + kReach);
  std::vector<std::size_t> distinct;
  std::vector<std::uint8_t> before;
  for (std::size_t place = first; place <= last; ++place) {
    std::vector<std::uint8_t> pixels = images.read(place).pixels;
    const bool copy = pixels == before;
    if (!copy) distinct.push_back(place);
    if (copy && place == all.at) distinct.back() = place;  // the reference stands for its copies
    before = std::move(pixels);
  }
  if (distinct.size() < 2) {
    throw NoAnswerError("the frames from " + std::to_string(scene.frames[first].id) + " to " +
                        std::to_string(scene.frames[last].id) +
                        " have the same image: no parallax between them");
  }
  return Reference(scene, std::move(distinct), all.at);
}

/// Of the texture near the camera, the share that stands still in the pictures about the reference.
double share_about(const Scene& scene, const Reference& reference, SmallImages& images) {
  constexpr std::size_t kEachSide = 3;
  const std::size_t first = reference.at - std::min(reference.behind(), kEachSide);
  const std::size_t last = reference.at + std::min(reference.ahead(), kEachSide);
  std::vector<GrayImage> held;
  for (std::size_t i = first; i <= last; ++i) held.push_back(images.read(reference.places[i]));
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : held) pointers.push_back(&image);
  const int height = held.front().height;
  const double middle = scene.camera.cy * height / scene.camera.height;
  return still_share(pointers, std::clamp(static_cast<int>(middle), 0, height - 1));
}

ChosenFrames choose_among(const Scene& scene, const Reference& reference, SmallImages& images,
                          int each_side) {
  const std::size_t most = std::max(reference.behind(), reference.ahead());
  if (most == 1) return reference.with_spacing(1, each_side);
  const GrayImage here = images.read(reference.places[reference.at]);
  const double enough = kEnoughNearParallax * scene.camera.fx;
  double parallax_px = 0.0;
  // Where the picture's near texture stands still: px, to the next frame, of what is near and of
  // what moves most.
  std::optional<ImageParallax> still;
  std::size_t spacing = 1;
  while (true) {
    const std::size_t other =
        spacing <= reference.ahead() ? reference.at + spacing : reference.at - spacing;
    const ImageParallax parallax =
        image_parallax(scene.camera, here, images.read(reference.places[other]),
                       spacing == 1 ? kLeastNearMatched : 0.0);
    if (spacing == 1 && parallax.most > kLeastStep &&
        share_about(scene, reference, images) > kRepeated) {
      still = parallax;
    }
    // Too fast to be matched at this size is not too slow.
    parallax_px = parallax.near.value_or(enough);
    if (parallax_px >= enough) break;
    // A camera that crawls moves what is near the farther the longer it goes; a film's coder that
    // repeats the road does not.
    if (still && spacing > 1 && still->near &&
        parallax_px <= 0.5 * static_cast<double>(spacing) * *still->near) {
      const double needed = kEnoughMoved * enough / still->most;
      spacing = std::clamp<std::size_t>(static_cast<std::size_t>(std::ceil(needed)), 1, spacing);
      parallax_px = still->most * static_cast<double>(spacing) / kEnoughMoved;
      break;
    }
    // Twice as far, or what the speed so far calls for; never farther than there are frames.
    const double factor = std::clamp(enough / std::max(parallax_px, 0.1), 1.5, 4.0);
    const auto next = std::min(
        most, std::max(spacing + 1, static_cast<std::size_t>(
                                        std::lround(factor * static_cast<double>(spacing)))));
    if (next == spacing) break;
    spacing = next;
  }
  ChosenFrames out = reference.with_spacing(spacing, each_side);
  out.parallax_px = parallax_px;
  return out;
}

}  // namespace

ChosenFrames choose_frames(const Scene& scene, const FramePixelSource& pixels, int each_side) {
  if (each_side != 1 && each_side != 2) {
    throw std::invalid_argument("choose_frames: each_side is " + std::to_string(each_side) +
                                ", 1 or 2 expected");
  }
  const Reference reference(scene);
  if (std::max(reference.behind(), reference.ahead()) == 1) {
    return reference.with_spacing(1, each_side);  // nothing to choose
  }
  SmallImages images(scene, pixels);
  ChosenFrames out = choose_among(scene, reference, images, each_side);
  if (has_copies(scene, out.ids, images)) {
    out = choose_among(scene, without_copies(scene, reference, images), images, each_side);
  }
  return out;
}

}  // namespace camber
