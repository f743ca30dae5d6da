#include "camber/cloud/detail/laz/layered_items.h"

#include <algorithm>
#include <vector>

#include "camber/cloud/detail/laz/arithmetic_decoder.h"
#include "camber/cloud/detail/laz/arithmetic_encoder.h"
#include "camber/cloud/detail/laz/item_parts.h"

namespace camber::laz {
namespace {

// Places in the 30 bytes that all points of formats 6 to 10 have.
constexpr std::size_t kIntensity = 12, kReturns = 14, kFlags = 15, kClass = 16, kUser = 17,
                      kAngle = 18, kSource = 20, kTime = 22, kPointSize = 30;

/// Layers of the item with the coordinates, in the order of the file.
enum PointLayer {
  kXyLayer,
  kZLayer,
  kClassLayer,
  kFlagLayer,
  kIntensityLayer,
  kAngleLayer,
  kUserLayer,
  kSourceLayer,
  kTimeLayer
};

unsigned channel_of(const unsigned char* point) { return point[kFlags] >> 4 & 3u; }
unsigned number_of(const unsigned char* point) { return point[kReturns] & 15u; }
unsigned returns_of(const unsigned char* point) { return point[kReturns] >> 4; }
/// The flags without the channel: 6 bits.
unsigned flags_of(const unsigned char* point) {
  return (point[kFlags] & 15u) | (point[kFlags] >> 2 & 0x30u);
}
/// 1 for a first return, 2 for a last one, 3 for a single one.
unsigned place_of_return(unsigned number, unsigned returns) {
  return (number == 1 ? 1u : 0u) + (number >= returns ? 2u : 0u);
}

/// What is known of the points of one scanner channel.
struct PointChannel {
  PointChannel(const unsigned char* point, bool /*unused*/) {
    std::memcpy(last, point, kPointSize);
    intensity.fill(get<std::uint16_t>(point + kIntensity));
    z.fill(get<std::int32_t>(point + 8));
    times.start(get<std::int64_t>(point + kTime));
  }

  unsigned char last[kPointSize];
  bool time_changed = false;  // from the point before the last
  std::array<std::uint16_t, 8> intensity;
  std::array<RunningMedian, 12> median_x, median_y;
  std::array<std::int32_t, 8> z;
  SymbolModels changed{8, 128};
  SymbolModel next_channel{3};
  SymbolModels returns{16, 16}, numbers{16, 16};
  SymbolModel number_of_same_time{13};
  CoordinateModels xyz;
  SymbolModels classes{64, 256}, flags{64, 64}, users{64, 256};
  IntegerModel intensities{16, 4}, angles{16, 2}, sources{16};
  TimeModels times{false};
};

template <typename Coder>
class Point14 : public LayeredItem<Coder> {
 public:
  explicit Point14(unsigned version) : version_(version) {}

  void start(const unsigned char* item, unsigned* channel) override {
    *channel = current_ = channel_of(item);
    channels_[current_] = std::make_unique<PointChannel>(item, true);
  }

  void code(Layer<Coder>* layers, unsigned char* item, unsigned* channel) override {
    const unsigned changed = code_changes(layers[kXyLayer], item);
    // In version 3 the other items go back to channel 0 where the channel stays.
    *channel = version_ >= 4 || (changed & kChannelChanged) != 0 ? current_ : 0;
    PointChannel& c = *channels_[current_];
    if constexpr (!Coder::kEncoding) std::memcpy(item, c.last, kPointSize);
    const bool time_changed = (changed & kTimeChanged) != 0;
    code_returns(layers[kXyLayer].coder, c, changed, item);
    const unsigned returns = returns_of(item), number = number_of(item);
    const unsigned place = place_of_return(number, returns);
    const bool single = returns == 1;
    const auto median = static_cast<std::size_t>(kReturnContext6[returns][number] - '0') * 2 +
                        (time_changed ? 1 : 0);
    c.xyz.code_xy(layers[kXyLayer].coder, c.median_x[median], c.median_y[median], single, c.last,
                  item);
    if (enter(layers[kZLayer], c, item, 8, 4)) {
      c.xyz.code_z(layers[kZLayer].coder, &c.z[return_level(returns, number)], single, item);
    }
    if (enter(layers[kClassLayer], c, item, kClass, 1)) {
      const std::size_t context = (c.last[kClass] & 31u) * 2 + (place == 3 ? 1 : 0);
      code_byte(layers[kClassLayer].coder, c.classes[context], item + kClass);
    }
    code_flags(layers[kFlagLayer], c, item);
    if (enter(layers[kIntensityLayer], c, item, kIntensity, 2)) {
      std::uint16_t& last = c.intensity[place * 2 + (time_changed ? 1 : 0)];
      code_u16(layers[kIntensityLayer].coder, c.intensities, last, place, item + kIntensity);
      last = get<std::uint16_t>(item + kIntensity);
    }
    if ((changed & kAngleChanged) != 0 && enter(layers[kAngleLayer], c, item, kAngle, 2)) {
      code_u16(layers[kAngleLayer].coder, c.angles, get<std::uint16_t>(c.last + kAngle),
               time_changed ? 1 : 0, item + kAngle);
    }
    if (enter(layers[kUserLayer], c, item, kUser, 1)) {
      code_byte(layers[kUserLayer].coder, c.users[c.last[kUser] / 4], item + kUser);
    }
    if ((changed & kSourceChanged) != 0 && enter(layers[kSourceLayer], c, item, kSource, 2)) {
      code_u16(layers[kSourceLayer].coder, c.sources, get<std::uint16_t>(c.last + kSource), 0,
               item + kSource);
    }
    if (time_changed && enter(layers[kTimeLayer], c, item, kTime, 8)) {
      put(item + kTime, c.times.code(layers[kTimeLayer].coder,
                                     Coder::kEncoding ? get<std::int64_t>(item + kTime) : 0));
    }
    std::memcpy(c.last, item, kPointSize);
    c.time_changed = time_changed;
  }

 private:
  /// Bits of the first symbol of a point; the lowest two are how the return's number changes.
  enum Changed : unsigned {
    kReturnsChanged = 4,
    kAngleChanged = 8,
    kTimeChanged = 16,
    kSourceChanged = 32,
    kChannelChanged = 64
  };

  /// What changed, and goes over to the point's channel.
  unsigned code_changes(Layer<Coder>& layer, const unsigned char* item) {
    PointChannel& before = *channels_[current_];
    unsigned changed = 0, channel = 0;
    if constexpr (Coder::kEncoding) {
      channel = channel_of(item);
      const unsigned char* const last = channels_[channel] ? channels_[channel]->last : before.last;
      const auto differs = [&](std::size_t at, std::size_t size) {
        return std::memcmp(item + at, last + at, size) != 0;
      };
      const unsigned step = (number_of(item) - number_of(last)) & 15;
      changed = (step < 2     ? step
                 : step == 15 ? 2u
                              : 3u) |
                (returns_of(item) != returns_of(last) ? kReturnsChanged : 0u) |
                (differs(kAngle, 2) ? kAngleChanged : 0u) |
                (differs(kTime, 8) ? kTimeChanged : 0u) |
                (differs(kSource, 2) ? kSourceChanged : 0u) |
                (channel != current_ ? kChannelChanged : 0u);
    }
    const unsigned context = place_of_return(number_of(before.last), returns_of(before.last)) +
                             (before.time_changed ? 4 : 0);
    changed = layer.coder.symbol(before.changed[context], changed);
    if ((changed & kChannelChanged) != 0) {
      const unsigned step = layer.coder.symbol(before.next_channel, (channel - current_ - 1) & 3);
      current_ = (current_ + step + 1) & 3;
      std::unique_ptr<PointChannel>& next = channels_[current_];
      if (!next) next = std::make_unique<PointChannel>(before.last, true);
      next->last[kFlags] =
          static_cast<unsigned char>((next->last[kFlags] & ~0x30u) | current_ << 4);
    }
    return changed;
  }

  void code_returns(Coder& coder, PointChannel& c, unsigned changed, unsigned char* item) {
    const unsigned last_returns = returns_of(c.last), last_number = number_of(c.last);
    unsigned returns = last_returns;
    if ((changed & kReturnsChanged) != 0) {
      returns = coder.symbol(c.returns[last_returns], returns_of(item));
    }
    unsigned number = last_number;
    switch (changed & 3) {
      case 1:
        number = last_number + 1;
        break;
      case 2:
        number = last_number + 15;
        break;
      case 3:
        if ((changed & kTimeChanged) != 0) {
          number = coder.symbol(c.numbers[last_number], number_of(item));
        } else {
          number = last_number + 2 +
                   coder.symbol(c.number_of_same_time, (number_of(item) - last_number - 2) & 15);
        }
        break;
      default:
        break;
    }
    if constexpr (!Coder::kEncoding) {
      item[kReturns] = static_cast<unsigned char>(returns << 4 | (number & 15));
    }
  }

  void code_flags(Layer<Coder>& layer, PointChannel& c, unsigned char* item) {
    if (!layer.on) return;
    const unsigned last = flags_of(c.last);
    const unsigned flags = layer.coder.symbol(c.flags[last], flags_of(item));
    layer.changed = layer.changed || flags != last;
    if constexpr (!Coder::kEncoding) {
      item[kFlags] =
          static_cast<unsigned char>((flags & 15) | (item[kFlags] & 0x30u) | (flags & 0x30) << 2);
    }
  }

  /// Whether a layer is coded; notes whether its value is another one.
  static bool enter(Layer<Coder>& layer, const PointChannel& c, const unsigned char* item,
                    std::size_t at, std::size_t size) {
    if constexpr (Coder::kEncoding) {
      layer.changed = layer.changed || std::memcmp(item + at, c.last + at, size) != 0;
    }
    return layer.on;
  }
  static void code_byte(Coder& coder, SymbolModel& model, unsigned char* byte) {
    *byte = static_cast<unsigned char>(coder.symbol(model, *byte));
  }
  static void code_u16(Coder& coder, IntegerModel& model, std::uint16_t last, unsigned context,
                       unsigned char* value) {
    const std::int32_t coded = model.code(coder, last, context, get<std::uint16_t>(value));
    put(value, static_cast<std::uint16_t>(coded));
  }

  unsigned version_;
  unsigned current_ = 0;
  std::array<std::unique_ptr<PointChannel>, 4> channels_;
};

/// The contexts of the other items by scanner channel.
template <typename Models>
class Channels {
 public:
  explicit Channels(unsigned version) : version_(version) {}

  void start(const unsigned char* item, std::size_t size, unsigned channel) {
    current_ = channel;
    add(channel, item, size);
  }
  /// Goes over to a channel. @return the item that is the last one now: in version 3 that of the
  /// channel before, but where the channel is new.
  unsigned char* enter(unsigned channel, std::size_t size) {
    unsigned char* last = last_[current_].data();
    if (channel != current_) {
      if (!models_[channel]) {
        add(channel, last, size);
        last = last_[channel].data();
      } else if (version_ >= 4) {
        last = last_[channel].data();
      }
      current_ = channel;
    }
    return last;
  }
  Models& models() { return *models_[current_]; }

 private:
  void add(unsigned channel, const unsigned char* item, std::size_t size) {
    last_[channel].assign(item, item + size);
    models_[channel] = std::make_unique<Models>(size);
  }

  unsigned version_;
  unsigned current_ = 0;
  std::array<std::vector<unsigned char>, 4> last_;
  std::array<std::unique_ptr<Models>, 4> models_;
};

/// Colours and, where the record has it, near infrared: two layers.
template <typename Coder>
class Color14 : public LayeredItem<Coder> {
 public:
  Color14(unsigned version, std::size_t size) : size_(size), channels_(version) {}

  void start(const unsigned char* item, unsigned* channel) override {
    channels_.start(item, size_, *channel);
  }
  void code(Layer<Coder>* layers, unsigned char* item, unsigned* channel) override {
    unsigned char* const last = channels_.enter(*channel, size_);
    Models& models = channels_.models();
    if constexpr (Coder::kEncoding) {
      layers[0].changed = layers[0].changed || std::memcmp(item, last, kColorSize) != 0;
    } else if (!layers[0].on) {
      std::memcpy(item, last, kColorSize);
    }
    if (layers[0].on) models.color.code(layers[0].coder, last, item);
    std::memcpy(last, item, kColorSize);
    if (size_ == kColorSize) return;
    code_infrared(layers[1], models, last + kColorSize, item + kColorSize);
  }

 private:
  static constexpr std::size_t kColorSize = 6;

  struct Models {
    explicit Models(std::size_t /*unused*/) {}
    ColorModels color;
    SymbolModel infrared_changed{4};
    SymbolModels infrared{2, 256};
  };

  static void code_infrared(Layer<Coder>& layer, Models& models, unsigned char* last,
                            unsigned char* item) {
    if (!layer.on) {
      std::memcpy(item, last, 2);
      return;
    }
    unsigned changed = 0;
    if constexpr (Coder::kEncoding) {
      changed = (item[0] != last[0] ? 1u : 0u) | (item[1] != last[1] ? 2u : 0u);
      layer.changed = layer.changed || changed != 0;
    }
    changed = layer.coder.symbol(models.infrared_changed, changed);
    for (unsigned i = 0; i < 2; ++i) {
      if ((changed & 1u << i) != 0) {
        const unsigned step =
            layer.coder.symbol(models.infrared[i], static_cast<unsigned>(item[i] - last[i]) & 255);
        last[i] = static_cast<unsigned char>(last[i] + step);
      }
      item[i] = last[i];
    }
  }

  std::size_t size_;
  Channels<Models> channels_;
};

template <typename Coder>
class WavePacket14 : public LayeredItem<Coder> {
 public:
  explicit WavePacket14(unsigned version) : channels_(version) {}

  void start(const unsigned char* item, unsigned* channel) override {
    channels_.start(item, kSize, *channel);
  }
  void code(Layer<Coder>* layers, unsigned char* item, unsigned* channel) override {
    unsigned char* const last = channels_.enter(*channel, kSize);
    if constexpr (Coder::kEncoding) {
      layers[0].changed = layers[0].changed || std::memcmp(item, last, kSize) != 0;
    } else if (!layers[0].on) {
      std::memcpy(item, last, kSize);
    }
    if (layers[0].on) channels_.models().packet.code(layers[0].coder, last, item);
    std::memcpy(last, item, kSize);
  }

 private:
  static constexpr std::size_t kSize = 29;
  struct Models {
    explicit Models(std::size_t /*unused*/) {}
    WavePacketModels packet;
  };
  Channels<Models> channels_;
};

/// Extra bytes: a layer each.
template <typename Coder>
class Bytes14 : public LayeredItem<Coder> {
 public:
  Bytes14(unsigned version, std::size_t size) : size_(size), channels_(version) {}

  void start(const unsigned char* item, unsigned* channel) override {
    channels_.start(item, size_, *channel);
  }
  void code(Layer<Coder>* layers, unsigned char* item, unsigned* channel) override {
    unsigned char* const last = channels_.enter(*channel, size_);
    Models& models = channels_.models();
    for (std::size_t i = 0; i < size_; ++i) {
      if (layers[i].on) {
        const unsigned step =
            layers[i].coder.symbol(models.bytes[i], static_cast<unsigned>(item[i] - last[i]) & 255);
        layers[i].changed = layers[i].changed || step != 0;
        last[i] = static_cast<unsigned char>(last[i] + step);
      }
      item[i] = last[i];
    }
  }

 private:
  struct Models {
    explicit Models(std::size_t size) : bytes(size, 256) {}
    SymbolModels bytes;
  };
  std::size_t size_;
  Channels<Models> channels_;
};

}  // namespace

template <typename Coder>
std::unique_ptr<LayeredItem<Coder>> make_layered_item(const LazItem& item) {
  switch (item.type) {
    case LazItem::kPoint14:
      return std::make_unique<Point14<Coder>>(item.version);
    case LazItem::kColor14:
    case LazItem::kColorInfrared14:
      return std::make_unique<Color14<Coder>>(item.version, item.size);
    case LazItem::kWavePacket14:
      return std::make_unique<WavePacket14<Coder>>(item.version);
    default:
      break;
  }
  return std::make_unique<Bytes14<Coder>>(item.version, item.size);
}

template std::unique_ptr<LayeredItem<ArithmeticDecoder>> make_layered_item(const LazItem&);
template std::unique_ptr<LayeredItem<ArithmeticEncoder>> make_layered_item(const LazItem&);

}  // namespace camber::laz
