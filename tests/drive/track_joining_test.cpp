#include "camber/drive/detail/track_joining.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace camber::internal {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using Groups = std::vector<std::vector<Detection>>;

/// Detections of a drive at 10 Hz, and windows of frames that link them.
class Drive {
 public:
  /// @param at  m, in the world; known to 0.2 m across and 1 m along z.
  void put(int frame, int id, const Eigen::Vector3d& at, const std::string& kind = "car") {
    PlacedDetection d;
    d.vehicle_class = kind;
    d.place.time_s = 0.1 * frame;
    d.place.in_world = at;
    d.place.covariance = Eigen::Vector3d(0.04, 0.04, 1.0).asDiagonal();
    placed_[{frame, id}] = d;
  }
  /// A window about its middle frame whose tracks are these detections.
  void window(const std::vector<int>& frames, const Groups& tracks) {
    WindowMeasurement w;
    w.frames = frames;
    w.reference = frames[frames.size() / 2];
    w.vehicles.resize(1);
    w.vehicles[0].id = w.reference;
    for (const auto& [detection, of] : placed_) {
      if (detection.first != w.reference) continue;
      VehicleEstimate v;
      v.id = detection.second;
      w.vehicles[0].vehicles.push_back(v);
    }
    for (std::size_t t = 0; t < tracks.size(); ++t) {
      for (const Detection& d : tracks[t]) {
        w.tracked.push_back({d.first, d.second, static_cast<int>(t)});
      }
    }
    windows_.push_back(std::move(w));
  }
  Groups joined() const { return join_detections(windows_, placed_); }
  Groups joined_without_metres() const { return join_detections(windows_, {}); }

 private:
  std::map<Detection, PlacedDetection> placed_;
  std::vector<WindowMeasurement> windows_;
};

TEST(TrackJoining, NeighboursThatAllWindowsJoinAreOne) {
  Drive drive;
  for (int k = 0; k < 4; ++k) drive.put(k, 0, {0, 0, 20.0 + (k == 2 ? 30.0 : 0.0)});  // one is off
  drive.window({0, 1, 2}, {{{0, 0}, {1, 0}, {2, 0}}});
  drive.window({1, 2, 3}, {{{1, 0}, {2, 0}, {3, 0}}});
  EXPECT_THAT(drive.joined(), ElementsAre(ElementsAre(Detection{0, 0}, Detection{1, 0},
                                                      Detection{2, 0}, Detection{3, 0})));
}

/// Frames 0 to 5 of a vehicle that is then gone; another appears in frame 7, `ahead` of it. A third
/// is there all the time.
Drive row_of_two(double ahead) {
  Drive drive;
  for (int k = 0; k < 12; ++k) {
    drive.put(k, 9, {-3, 0, 30});
    if (k != 6) drive.put(k, 0, {3, 0, k < 6 ? 20 : 20 + ahead});
  }
  for (int first = 0; first < 8; ++first) {
    Groups tracks(2);
    std::vector<int> frames;
    for (int k = first; k < first + 5; ++k) {
      frames.push_back(k);
      tracks[0].emplace_back(k, 9);
      if (k != 6) tracks[1].emplace_back(k, 0);
    }
    drive.window(frames, tracks);
  }
  return drive;
}

TEST(TrackJoining, ALinkOverAGapHasToGoWhereTheVehicleGoes) {
  EXPECT_EQ(row_of_two(0.5).joined().size(), 2U);
  const Groups three = row_of_two(8.0).joined();  // the next in a row of parked ones
  ASSERT_EQ(three.size(), 3U);
  EXPECT_EQ(three[0].size(), 6U);
  EXPECT_EQ(three[2].front(), (Detection{7, 0}));
  // In a vehicle's own units nothing tells how far it may go.
  EXPECT_EQ(row_of_two(8.0).joined_without_metres().size(), 2U);
}

TEST(TrackJoining, WhatOneWindowOfThreeJoinsHasToGoThereToo) {
  const auto with = [](double aside) {
    Drive drive;
    for (int k = 0; k < 3; ++k) drive.put(k, 0, {0, 0, 20});
    for (int k = 3; k < 6; ++k) drive.put(k, 0, {aside, 0, 20});
    drive.window({0, 1, 2, 3}, {{{0, 0}, {1, 0}, {2, 0}}, {{3, 0}}});
    drive.window({1, 2, 3, 4}, {{{1, 0}, {2, 0}, {3, 0}, {4, 0}}});
    drive.window({2, 3, 4, 5}, {{{2, 0}}, {{3, 0}, {4, 0}, {5, 0}}});
    return drive.joined();
  };
  EXPECT_EQ(with(0.1).size(), 1U);
  EXPECT_EQ(with(4.0).size(), 2U);
}

/// A vehicle of 12 views that is hidden for some time, then seen 8 times again.
/// @param speed  m/s along x. @param beside  m, of the later views from where it goes.
Groups hidden(double seconds, double speed, double beside = 0.0,
              const std::string& later_class = "car") {
  Drive drive;
  const int gap = static_cast<int>(10 * seconds);
  Groups parts(2);
  for (int k = 0; k < 20; ++k) {
    const bool later = k >= 12;
    const int frame = later ? k + gap : k;
    drive.put(frame, 3, {0.1 * frame * speed + (later ? beside : 0.0), 0, 20},
              later ? later_class : "car");
    parts[later ? 1 : 0].emplace_back(frame, 3);
  }
  for (const auto& part : parts) {
    for (std::size_t i = 1; i + 1 < part.size(); ++i) {
      drive.window({part[i - 1].first, part[i].first, part[i + 1].first},
                   {{part[i - 1], part[i], part[i + 1]}});
    }
    // Windows about the ends, so that every detection is placed.
    drive.window({part[0].first, part[1].first}, {{part[0], part[1]}});
  }
  return drive.joined();
}

TEST(TrackJoining, AVehicleThatWasHiddenIsTheSame) {
  EXPECT_EQ(hidden(2.0, 0.0).size(), 1U);
  EXPECT_EQ(hidden(0.8, 12.0).size(), 1U);
  EXPECT_EQ(hidden(2.0, 0.0, 5.0).size(), 2U);  // the next parking place
  EXPECT_EQ(hidden(2.0, 0.0, 0.0, "truck").size(), 2U);
  EXPECT_EQ(hidden(4.0, 0.0).size(), 2U);  // too long ago
}

TEST(TrackJoining, OneWindowAloneDoesNotTurnAVehicleIntoAnother) {
  // Two parked cars 3 m apart. The left one is there but in frame 6; the right one was hidden from
  // frame 3 to 5, and in 6 the only window takes it for the left one.
  Drive drive;
  for (int k = 0; k < 12; ++k) {
    if (k != 6) drive.put(k, 0, {0, 0, 20});
    if (k < 3 || k > 5) drive.put(k, 1, {3, 0, 20});
  }
  drive.window({0, 1, 2, 3}, {{{0, 0}, {1, 0}, {2, 0}, {3, 0}}, {{0, 1}, {1, 1}, {2, 1}}});
  drive.window({3, 4, 5, 6}, {{{3, 0}, {4, 0}, {5, 0}, {6, 1}}});
  drive.window({6, 7, 8, 9}, {{{6, 1}, {7, 1}, {8, 1}, {9, 1}}, {{7, 0}, {8, 0}, {9, 0}}});
  drive.window({8, 9, 10, 11},
               {{{8, 0}, {9, 0}, {10, 0}, {11, 0}}, {{8, 1}, {9, 1}, {10, 1}, {11, 1}}});
  const Groups joined = drive.joined();
  ASSERT_EQ(joined.size(), 2U);
  for (const std::vector<Detection>& group : joined) {
    for (const Detection& d : group) EXPECT_EQ(d.second, group.front().second) << d.first;
  }
}

TEST(TrackJoining, WindowsOfAStandstillJoinNoFramesASecondApart) {
  // The camera stands from frame 2 to 11; what is between is measured against these two. One car
  // leaves the picture in frame 6, another stands where it was seen from the last frame on.
  Drive drive;
  for (int k = 0; k < 6; ++k) drive.put(k, 0, {0, 0, 20.0 - 1.5 * k});
  for (int k = 11; k < 16; ++k) drive.put(k, 1, {1.5, 0, 17});
  for (int k = 0; k < 16; ++k) drive.put(k, 9, {-3, 0, 30});
  drive.window({0, 1, 2}, {{{0, 0}, {1, 0}, {2, 0}}, {{0, 9}, {1, 9}, {2, 9}}});
  for (int k = 3; k < 11; ++k) {
    Groups tracks = {{{2, 9}, {k, 9}, {11, 9}}, {{2, 0}}};
    if (k < 6) tracks[1].emplace_back(k, 0);
    tracks[1].emplace_back(11, 1);
    drive.window({2, k, 11}, tracks);
  }
  drive.window({11, 12, 13, 14, 15}, {{{11, 9}, {12, 9}, {13, 9}, {14, 9}, {15, 9}},
                                      {{11, 1}, {12, 1}, {13, 1}, {14, 1}, {15, 1}}});
  for (const std::vector<Detection>& group : drive.joined()) {
    for (const Detection& d : group) EXPECT_EQ(d.second, group.front().second) << d.first;
  }
}

TEST(TrackJoining, FramesThatNoWindowJoinsFallIntoTheirPlace) {
  // One that moves is seen all the time, in frames 6 and 9 by themselves; another stands beside it.
  Drive drive;
  Groups moving(1), parked(1);
  for (int k = 0; k < 16; ++k) {
    drive.put(k, 0, {0.5 * k, 0, 20});
    drive.put(k, 1, {4, 0, 24});
    if (k == 6 || k == 9) continue;
    moving[0].emplace_back(k, 0);
    parked[0].emplace_back(k, 1);
  }
  std::vector<int> frames;
  for (const Detection& d : moving[0]) frames.push_back(d.first);
  drive.window(frames, {moving[0], parked[0]});
  drive.window({6}, {});
  drive.window({9}, {});
  const Groups joined = drive.joined();
  ASSERT_EQ(joined.size(), 2U);
  for (const std::vector<Detection>& group : joined) {
    EXPECT_EQ(group.size(), 16U);
    for (const Detection& d : group) EXPECT_EQ(d.second, group.front().second) << d.first;
  }
}

TEST(TrackJoining, NoTwoOfAFrameAreOne) {
  Drive drive;
  for (int k = 0; k < 3; ++k) {
    drive.put(k, 0, {0, 0, 20});
    drive.put(k, 1, {0, 0, 20});
  }
  drive.window({0, 1, 2}, {{{0, 0}, {1, 0}, {2, 0}}, {{0, 1}, {1, 1}, {2, 1}}});
  drive.window({0, 1, 2}, {{{0, 1}, {1, 0}}, {{0, 0}, {1, 1}}});  // one mistakes them
  for (const auto& group : drive.joined()) {
    for (std::size_t i = 1; i < group.size(); ++i) EXPECT_LT(group[i - 1].first, group[i].first);
  }
  EXPECT_THAT(Drive().joined(), IsEmpty());
}

}  // namespace
}  // namespace camber::internal
