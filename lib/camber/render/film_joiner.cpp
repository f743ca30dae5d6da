extern "C" {
#include <libavformat/avformat.h>
#include <libavutil/error.h>
}

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <string>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/render/detail/film_encoder.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

std::string reason_of(int error) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  av_strerror(error, text.data(), text.size());
  return text.data();
}

struct CloseInput {
  void operator()(AVFormatContext* context) const { avformat_close_input(&context); }
};
using Input = std::unique_ptr<AVFormatContext, CloseInput>;

struct FreePacket {
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
};
using Packet = std::unique_ptr<AVPacket, FreePacket>;

Input open_part(const fs::path& path) {
  AVFormatContext* context = nullptr;
  const int error = avformat_open_input(&context, path.c_str(), nullptr, nullptr);
  if (error < 0) throw InputError(path.string(), "cannot be opened: " + reason_of(error));
  Input out(context);
  const int unknown = avformat_find_stream_info(context, nullptr);
  if (unknown < 0 || context->nb_streams != 1) {
    throw InputError(path.string(), "found no film of one stream, as Camber writes them");
  }
  return out;
}

bool alike(const AVCodecParameters& a, const AVCodecParameters& b) {
  return a.codec_id == b.codec_id && a.width == b.width && a.height == b.height &&
         a.extradata_size == b.extradata_size &&
         std::memcmp(a.extradata, b.extradata, static_cast<std::size_t>(a.extradata_size)) == 0;
}

/// The film that the others are put into.
class Joined {
 public:
  Joined(const fs::path& path, const AVStream& like) : path_(path) {
    check(avformat_alloc_output_context2(&context_, nullptr, nullptr, path.c_str()));
    stream_ = avformat_new_stream(context_, nullptr);
    if (!stream_) throw OutputError(path_.string(), "out of memory");
    check(avcodec_parameters_copy(stream_->codecpar, like.codecpar));
    stream_->codecpar->codec_tag = 0;
    stream_->time_base = like.time_base;
    stream_->avg_frame_rate = like.avg_frame_rate;
    check(avio_open(&context_->pb, path.c_str(), AVIO_FLAG_WRITE));
    check(avformat_write_header(context_, nullptr));
  }
  ~Joined() {
    if (!context_) return;
    if (context_->pb) avio_closep(&context_->pb);
    avformat_free_context(context_);
  }
  Joined(const Joined&) = delete;
  Joined& operator=(const Joined&) = delete;

  const AVCodecParameters& parameters() const { return *stream_->codecpar; }

  /// Puts a part's packets after what is there.
  void add(AVFormatContext* part) {
    const AVStream& from = *part->streams[0];
    const Packet packet(av_packet_alloc());
    std::int64_t end = 0;  // in units of the part
    while (true) {
      throw_if_interrupted();
      const int error = av_read_frame(part, packet.get());
      if (error == AVERROR_EOF) break;
      check(error);
      end = std::max(end, packet->pts + packet->duration);
      av_packet_rescale_ts(packet.get(), from.time_base, stream_->time_base);
      packet->pts += start_;
      // Pictures are decoded at an even pace. A part of few pictures has none that are decoded
      // ahead of others, and its own times would leave a gap.
      if (!begun_) next_ = packet->dts;
      begun_ = true;
      packet->dts = std::min(next_, packet->pts);
      next_ = packet->dts + packet->duration;
      packet->stream_index = 0;
      packet->pos = -1;
      check(av_write_frame(context_, packet.get()));
      av_packet_unref(packet.get());
    }
    start_ += av_rescale_q(end, from.time_base, stream_->time_base);
  }

  void finish() {
    check(av_write_trailer(context_));
    check(avio_closep(&context_->pb));
  }

 private:
  void check(int error) const {
    if (error < 0) throw OutputError(path_.string(), "writing failed: " + reason_of(error));
  }

  fs::path path_;
  AVFormatContext* context_ = nullptr;
  AVStream* stream_ = nullptr;
  std::int64_t start_ = 0, next_ = 0;  // of the next part's first picture; of the next packet
  bool begun_ = false;
};

}  // namespace

void join_film_files(const std::vector<fs::path>& parts, const fs::path& out) {
  if (parts.empty()) throw OutputError(out.string(), "no part of the film is there");
  std::unique_ptr<Joined> joined;
  for (const fs::path& path : parts) {
    const Input part = open_part(path);
    if (!joined) joined = std::make_unique<Joined>(out, *part->streams[0]);
    if (!alike(joined->parameters(), *part->streams[0]->codecpar)) {
      throw InputError(path.string(), "the film is not of the encoder and size of the one before");
    }
    joined->add(part.get());
  }
  joined->finish();
}

}  // namespace camber
