#include "camber/cloud/detail/laz/chunk_codec.h"

#include <cstring>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/arithmetic_encoder.h"
#include "camber/cloud/detail/laz/layered_items.h"
#include "camber/cloud/detail/laz/pointwise_items.h"

namespace camber::laz {
namespace {

std::size_t record_size(const std::vector<LazItem>& items) {
  std::size_t size = 0;
  for (const LazItem& item : items) size += item.size;
  return size;
}

/// The items of a record, one after the other.
template <typename Coder>
class PointwiseRecord {
 public:
  explicit PointwiseRecord(const std::vector<LazItem>& items) {
    for (const LazItem& item : items) {
      items_.push_back(make_pointwise_item<Coder>(item));
      sizes_.push_back(item.size);
    }
  }
  void start(const unsigned char* record) {
    for (std::size_t i = 0; i < items_.size(); ++i) {
      items_[i]->start(record);
      record += sizes_[i];
    }
  }
  void code(Coder& coder, unsigned char* record) {
    for (std::size_t i = 0; i < items_.size(); ++i) {
      items_[i]->code(coder, record);
      record += sizes_[i];
    }
  }

 private:
  std::vector<std::unique_ptr<PointwiseItem<Coder>>> items_;
  std::vector<std::size_t> sizes_;
};

template <typename Coder>
class LayeredRecord {
 public:
  explicit LayeredRecord(const std::vector<LazItem>& items) {
    std::size_t layers = 0;
    for (const LazItem& item : items) {
      items_.push_back(make_layered_item<Coder>(item));
      sizes_.push_back(item.size);
      first_layers_.push_back(layers);
      layers += item.layers();
    }
    layers_.resize(layers);
  }
  std::vector<Layer<Coder>>& layers() { return layers_; }
  const std::vector<Layer<Coder>>& layers() const { return layers_; }

  void start(const unsigned char* record) {
    unsigned channel = 0;
    for (std::size_t i = 0; i < items_.size(); ++i) {
      items_[i]->start(record, &channel);
      record += sizes_[i];
    }
  }
  void code(unsigned char* record) {
    unsigned channel = 0;
    for (std::size_t i = 0; i < items_.size(); ++i) {
      items_[i]->code(layers_.data() + first_layers_[i], record, &channel);
      record += sizes_[i];
    }
  }

 private:
  std::vector<std::unique_ptr<LayeredItem<Coder>>> items_;
  std::vector<std::size_t> sizes_, first_layers_;
  std::vector<Layer<Coder>> layers_;
};

class PointwiseDecoder : public ChunkDecoder {
 public:
  PointwiseDecoder(const std::vector<LazItem>& items, const unsigned char* begin,
                   const unsigned char* end, ByteFeed* feed, const unsigned char** position)
      : record_(items),
        size_(record_size(items)),
        decoder_(begin, end, feed),
        end_(end),
        position_(position) {}

  std::size_t decode(unsigned char* out, std::size_t count) override {
    for (std::size_t i = 0; i < count; ++i, out += size_) {
      if (first_) {
        first_ = false;
        decoder_.copy(out, size_);
        record_.start(out);
        decoder_.start();
      } else {
        record_.code(decoder_, out);
      }
      if (decoder_.exhausted()) return i;
    }
    if (position_ != nullptr) *position_ = decoder_.position();
    return count;
  }
  bool suspicious() const override {
    return decoder_.damaged() || (position_ == nullptr && decoder_.position() != end_);
  }

 private:
  PointwiseRecord<ArithmeticDecoder> record_;
  std::size_t size_;
  ArithmeticDecoder decoder_;
  const unsigned char* end_;
  const unsigned char** position_;
  bool first_ = true;
};

class LayeredDecoder : public ChunkDecoder {
 public:
  LayeredDecoder(const std::vector<LazItem>& items, const std::string& bytes)
      : record_(items),
        size_(record_size(items)),
        at_(reinterpret_cast<const unsigned char*>(bytes.data())),
        end_(at_ + bytes.size()) {}

  /// @return what is wrong with the chunk's head, if anything is
  std::string open(const std::vector<LazItem>& items, std::uint64_t points, std::uint32_t wanted) {
    std::vector<Layer<ArithmeticDecoder>>& layers = record_.layers();
    const std::size_t head = size_ + 4 + 4 * layers.size();
    if (static_cast<std::size_t>(end_ - at_) < head) return "found no room for its head";
    const unsigned char* sizes = at_ + size_;
    const auto count = detail::load<std::uint32_t>(sizes);
    if (count != points) {
      return "found " + std::to_string(count) + " points in it, expected " + std::to_string(points);
    }
    const unsigned char* layer_start = at_ + head;
    std::size_t i = 0;
    for (const LazItem& item : items) {
      for (std::size_t k = 0; k < item.layers(); ++k, ++i) {
        sizes += 4;
        const auto layer_size = detail::load<std::uint32_t>(sizes);
        if (layer_size > static_cast<std::size_t>(end_ - layer_start)) {
          return "found " + std::to_string(layer_size) + " bytes in layer " +
                 std::to_string(i + 1) + ", expected at most " + std::to_string(end_ - layer_start);
        }
        const bool on = layer_size > 0 && (wants(item, k) & wanted) != 0;
        layers[i].on = on;
        layers[i].coder = ArithmeticDecoder(layer_start, layer_start + layer_size);
        if (on) layers[i].coder.start();
        ends_.push_back(layer_start + layer_size);
        layer_start += layer_size;
      }
    }
    rest_ = layer_start != end_;
    return {};
  }

  std::size_t decode(unsigned char* out, std::size_t count) override {
    for (std::size_t i = 0; i < count; ++i, out += size_) {
      if (first_) {
        first_ = false;
        std::memcpy(out, at_, size_);
        record_.start(out);
        continue;
      }
      record_.code(out);
      // The other layers are looked at once for all points.
      if (record_.layers()[0].coder.exhausted()) return i;
    }
    for (const auto& layer : record_.layers()) {
      if (layer.coder.exhausted()) return 0;
    }
    return count;
  }
  bool suspicious() const override {
    bool found = rest_;
    for (std::size_t i = 0; i < ends_.size(); ++i) {
      const auto& layer = record_.layers()[i];
      if (layer.on) found = found || layer.coder.damaged() || layer.coder.position() != ends_[i];
    }
    return found;
  }

 private:
  static std::uint32_t wants(const LazItem& item, std::size_t layer) {
    switch (item.type) {
      case LazItem::kPoint14:
        return layer == 0 ? kWantAll : 1u << layer;
      case LazItem::kColor14:
      case LazItem::kColorInfrared14:
        return layer == 0 ? kWantColor : kWantInfrared;
      case LazItem::kWavePacket14:
        return kWantWavePacket;
      default:
        return kWantBytes;
    }
  }

  LayeredRecord<ArithmeticDecoder> record_;
  std::size_t size_;
  const unsigned char* at_;
  const unsigned char* end_;
  std::vector<const unsigned char*> ends_;
  bool first_ = true, rest_ = false;
};

std::string encode_points(const std::vector<LazItem>& items, const unsigned char* records,
                          std::size_t count) {
  const std::size_t size = record_size(items);
  PointwiseRecord<ArithmeticEncoder> record(items);
  ArithmeticEncoder encoder;
  encoder.copy(records, size);
  record.start(records);
  std::vector<unsigned char> bytes(size);
  for (std::size_t i = 1; i < count; ++i) {
    std::memcpy(bytes.data(), records + i * size, size);
    record.code(encoder, bytes.data());
  }
  return encoder.finish();
}

std::string encode_layers(const std::vector<LazItem>& items, const unsigned char* records,
                          std::size_t count) {
  const std::size_t size = record_size(items);
  LayeredRecord<ArithmeticEncoder> record(items);
  record.start(records);
  std::vector<unsigned char> bytes(size);
  for (std::size_t i = 1; i < count; ++i) {
    std::memcpy(bytes.data(), records + i * size, size);
    record.code(bytes.data());
  }
  std::string out(reinterpret_cast<const char*>(records), size);
  out.resize(size + 4 + 4 * record.layers().size());
  detail::store(out, size, static_cast<std::uint32_t>(count));
  std::size_t at = size;
  std::string content;
  for (std::size_t i = 0; i < record.layers().size(); ++i) {
    Layer<ArithmeticEncoder>& layer = record.layers()[i];
    at += 4;
    // As LASzip does: coordinates are always there, other attributes where they change.
    if (i > 1 && !layer.changed) continue;
    const std::string coded = layer.coder.finish();
    detail::store(out, at, static_cast<std::uint32_t>(coded.size()));
    content += coded;
  }
  return out + content;
}

}  // namespace

std::unique_ptr<ChunkDecoder> make_pointwise_decoder(const std::vector<LazItem>& items,
                                                     const unsigned char* begin,
                                                     const unsigned char* end, ByteFeed* feed,
                                                     const unsigned char** position) {
  return std::make_unique<PointwiseDecoder>(items, begin, end, feed, position);
}

std::unique_ptr<ChunkDecoder> make_layered_decoder(const std::vector<LazItem>& items,
                                                   const std::string& bytes, std::uint64_t points,
                                                   std::uint32_t wanted, std::string* reason) {
  auto decoder = std::make_unique<LayeredDecoder>(items, bytes);
  *reason = decoder->open(items, points, wanted);
  if (!reason->empty()) return nullptr;
  return decoder;
}

std::string encode_chunk(const std::vector<LazItem>& items, const unsigned char* records,
                         std::size_t count) {
  return items.front().type >= LazItem::kPoint14 ? encode_layers(items, records, count)
                                                 : encode_points(items, records, count);
}

}  // namespace camber::laz
