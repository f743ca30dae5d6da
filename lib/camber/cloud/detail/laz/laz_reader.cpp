#include "camber/cloud/detail/laz/laz_reader.h"

#include <algorithm>

#include "camber/core/interruption.h"
#include "camber/core/threads.h"

namespace camber::laz {
namespace {

/// Whether a chunk is decoded as a whole. Others, of very many points or of more than their bytes
/// make likely, are decoded piece by piece, so that a false number takes no memory.
bool is_whole(const LazChunk& chunk, std::size_t record_length) {
  constexpr std::uint64_t kMostPoints = 1 << 20, kMostRatio = 64, kLeast = 1 << 16;
  return chunk.points <= kMostPoints &&
         chunk.points * record_length <= kMostRatio * chunk.size + kLeast;
}

/// LAZ has no checksums, but the points of a sound chunk take all of its bytes.
constexpr const char* kNoise = "found points that do not end where their bytes do";

std::string shown_chunk(std::size_t chunk, std::size_t count) {
  return "chunk " + std::to_string(chunk + 1) + " of " + std::to_string(count);
}

}  // namespace

/// The file's compressed points through a window.
class LazReader::Window : public ByteFeed {
 public:
  Window(const FileBytes& file, std::uint64_t start, std::uint64_t end)
      : file_(file), next_(start), end_(end) {}

  bool more(const unsigned char** begin, const unsigned char** end) override {
    constexpr std::uint64_t kSize = 1 << 18;
    if (next_ >= end_) return false;
    start_ = next_;
    bytes_ = file_.read(next_, std::min(kSize, end_ - next_));
    next_ += bytes_.size();
    *begin = reinterpret_cast<const unsigned char*>(bytes_.data());
    *end = *begin + bytes_.size();
    return true;
  }
  /// Where in the file a byte of the window is.
  std::uint64_t place(const unsigned char* byte) const {
    if (byte == nullptr || bytes_.empty()) return next_;
    return start_ +
           static_cast<std::uint64_t>(byte - reinterpret_cast<const unsigned char*>(bytes_.data()));
  }
  const unsigned char* window_end() const {
    return reinterpret_cast<const unsigned char*>(bytes_.data()) + bytes_.size();
  }

 private:
  const FileBytes& file_;
  std::string bytes_;
  std::uint64_t start_ = 0, next_, end_;
};

LazReader::LazReader(const LasFile& las, const LazReadOptions& options)
    : las_(las), layout_(*las.laz), options_(options), left_(las.points) {}

LazReader::~LazReader() = default;

void LazReader::fail(std::size_t chunk, std::uint64_t done, const std::string& reason) const {
  const bool known = chunk < layout_.chunks.size();
  const std::uint64_t start = known ? layout_.chunks[chunk].start : layout_.data_start;
  las_.bytes->fail_at(start, reason + " in " +
                                 (known ? shown_chunk(chunk, layout_.chunks.size()) + " (of " +
                                              std::to_string(layout_.chunks[chunk].size) + " bytes)"
                                        : "chunk " + std::to_string(chunk + 1)) +
                                 ", behind " + std::to_string(done) +
                                 " points; expected sound LAZ");
}

void LazReader::note_damage(std::size_t chunk, std::uint64_t done, const std::string& reason) {
  stopped_ = true;
  notes_.push_back("chunk " + std::to_string(chunk + 1) + " is damaged: " + reason + ", behind " +
                   std::to_string(done) + " points; the points before it are kept");
}

std::size_t LazReader::next(const unsigned char** records, std::size_t most) {
  if (left_ == 0 || stopped_) return 0;
  const bool large = !layout_.sequential && next_chunk_ < layout_.chunks.size() &&
                     !is_whole(layout_.chunks[next_chunk_], las_.record_length);
  if (at_chunk_ == group_.size() && (layout_.sequential || large || left_in_chunk_ > 0)) {
    return next_in_turn(records, most);
  }
  while (at_chunk_ == group_.size()) {
    if (!decode_group()) return 0;
  }
  const Whole& chunk = group_[at_chunk_];
  const std::size_t count = std::min(most, chunk.count - at_point_);
  *records = chunk.records.data() + at_point_ * las_.record_length;
  at_point_ += count;
  left_ -= count;
  if (at_point_ == chunk.count) {
    ++at_chunk_;
    at_point_ = 0;
  }
  return count;
}

void LazReader::decode_whole(std::size_t chunk, Whole* out) const {
  const LazChunk& place = layout_.chunks[chunk];
  const std::string bytes = las_.bytes->read(place.start, place.size);
  const auto* const begin = reinterpret_cast<const unsigned char*>(bytes.data());
  std::unique_ptr<ChunkDecoder> decoder;
  out->count = 0;
  out->error.clear();
  if (layout_.compressor == Compressor::kLayers) {
    decoder =
        make_layered_decoder(layout_.items, bytes, place.points, options_.wanted, &out->error);
    if (!decoder) return;
  } else {
    decoder = make_pointwise_decoder(layout_.items, begin, begin + bytes.size());
  }
  const auto points = static_cast<std::size_t>(place.points);
  out->records.resize(points * las_.record_length);
  out->count = decoder->decode(out->records.data(), points);
  if (out->count < points) {
    out->error = "found the end after " + std::to_string(out->count) + " of " +
                 std::to_string(points) + " points";
  } else if (decoder->suspicious()) {
    out->error = kNoise;
  }
  // Where the points of a damaged chunk begin to be wrong is not known.
  if (!out->error.empty()) out->count = 0;
}

/// The next chunks, one a thread; false at the end.
bool LazReader::decode_group() {
  at_chunk_ = at_point_ = 0;
  std::size_t count = 0;
  const auto threads = static_cast<std::size_t>(resolve_num_threads(options_.num_threads));
  while (count < threads && next_chunk_ + count < layout_.chunks.size() &&
         is_whole(layout_.chunks[next_chunk_ + count], las_.record_length)) {
    ++count;
  }
  group_.resize(count);
  if (count == 0) return false;
  parallel_for(count, options_.num_threads,
               [&](std::size_t i) { decode_whole(next_chunk_ + i, &group_[i]); });
  std::uint64_t done = las_.points - left_;
  for (std::size_t i = 0; i < count; ++i) {
    const Whole& chunk = group_[i];
    done += chunk.count;
    if (!chunk.error.empty()) {
      if (!options_.lenient) fail(next_chunk_ + i, done, chunk.error);
      note_damage(next_chunk_ + i, done, chunk.error);
      left_ = done - (las_.points - left_);
      stopped_ = left_ == 0;
      group_.resize(i);
      next_chunk_ = layout_.chunks.size();
      return !group_.empty();
    }
  }
  next_chunk_ += count;
  return true;
}

bool LazReader::open_next() {
  if (layout_.sequential) {
    if (!window_) {
      window_ = std::make_unique<Window>(*las_.bytes, layout_.data_start, layout_.data_end);
    }
    left_in_chunk_ = layout_.compressor == Compressor::kOneStream
                         ? left_
                         : std::min<std::uint64_t>(left_, layout_.chunk_size);
    const unsigned char* const begin = position_;
    decoder_ = make_pointwise_decoder(layout_.items, begin,
                                      begin == nullptr ? nullptr : window_->window_end(),
                                      window_.get(), &position_);
    return true;
  }
  const LazChunk& place = layout_.chunks[next_chunk_];
  left_in_chunk_ = place.points;
  if (layout_.compressor == Compressor::kLayers) {
    chunk_bytes_ = las_.bytes->read(place.start, place.size);
    std::string reason;
    decoder_ =
        make_layered_decoder(layout_.items, chunk_bytes_, place.points, options_.wanted, &reason);
    if (!decoder_) {
      if (!options_.lenient) fail(next_chunk_, las_.points - left_, reason);
      note_damage(next_chunk_, las_.points - left_, reason);
      return false;
    }
    return true;
  }
  window_ = std::make_unique<Window>(*las_.bytes, place.start, place.start + place.size);
  position_ = nullptr;
  decoder_ = make_pointwise_decoder(layout_.items, nullptr, nullptr, window_.get(), &position_);
  return true;
}

std::size_t LazReader::next_in_turn(const unsigned char** records, std::size_t most) {
  throw_if_interrupted();
  if (left_in_chunk_ == 0 && !open_next()) return 0;
  const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(most, left_in_chunk_));
  piece_.resize(count * las_.record_length);
  const std::size_t found = decoder_->decode(piece_.data(), count);
  left_ -= found;
  left_in_chunk_ -= found;
  const bool ended = left_in_chunk_ == 0;
  if (found < count || (ended && decoder_->suspicious())) {
    const std::string reason = found < count ? "found the end of the bytes" : kNoise;
    if (!options_.lenient) fail(next_chunk_, las_.points - left_, reason);
    note_damage(next_chunk_, las_.points - left_, reason);
  } else if (ended) {
    decoder_.reset();
    ++next_chunk_;
  }
  *records = piece_.data();
  return found;
}

}  // namespace camber::laz
