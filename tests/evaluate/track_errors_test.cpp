#include "camber/evaluate/track_errors.h"

#include <gtest/gtest.h>

namespace camber {
namespace {

/// Two vehicles side by side in every frame, found as told.
struct MadeTracks {
  Scene scene;
  VehicleDocument vehicles;

  explicit MadeTracks(int frames) {
    scene.camera = {1242, 375, 720.0, 720.0, 620.5, 187.0};
    scene.truth.emplace();
    for (int i = 0; i < frames; ++i) {
      SceneFrame frame;
      frame.id = i;
      scene.frames.push_back(frame);
      TruthFrame truth;
      truth.id = i;
      for (int k = 0; k < 2; ++k) {
        TruthVehicle vehicle;
        vehicle.id = 10 + k;
        vehicle.box = box(k);
        truth.vehicles.push_back(vehicle);
      }
      scene.truth->frames.push_back(truth);
      vehicles.frames.push_back({i, {}});
    }
  }

  static Box2 box(int k) { return {100.0 + 300.0 * k, 100.0, 200.0 + 300.0 * k, 180.0}; }

  /// @param k  place of the box; 0 and 1 are those of the true vehicles
  void find(int frame, int k, int track) {
    std::vector<VehicleEstimate>& list = vehicles.frames[static_cast<std::size_t>(frame)].vehicles;
    VehicleEstimate one;
    one.id = static_cast<int>(list.size());
    one.box = box(k);
    one.track = track;
    list.push_back(one);
  }
};

TEST(TrackErrors, OfAllThatIsRightAreNone) {
  MadeTracks made(4);
  for (int i = 0; i < 4; ++i) {
    made.find(i, 0, 5);
    made.find(i, 1, 6);
  }
  const TrackErrors e = track_errors(made.scene, made.vehicles);
  EXPECT_EQ(e.true_vehicles, 8);
  EXPECT_EQ(e.matched, 8);
  EXPECT_EQ(e.true_tracks, 2);
  EXPECT_DOUBLE_EQ(e.mota, 1.0);
  EXPECT_DOUBLE_EQ(e.motp, 1.0);
}

TEST(TrackErrors, AreCountedByKind) {
  MadeTracks made(5);
  // Vehicle 0: track 5, lost in frame 2, then track 7. Vehicle 1: tracks 6, and 5 from frame 3 on.
  const int first[] = {5, 5, -2, 7, 7}, second[] = {6, 6, 6, 5, 5};
  for (int i = 0; i < 5; ++i) {
    if (first[i] >= 0) made.find(i, 0, first[i]);
    made.find(i, 1, second[i]);
  }
  made.find(1, 2, 9);   // on nothing
  made.find(2, 0, -1);  // without a track
  const TrackErrors e = track_errors(made.scene, made.vehicles);
  EXPECT_EQ(e.matched, 9);
  EXPECT_EQ(e.missed, 1);
  EXPECT_EQ(e.false_positives, 1);
  EXPECT_EQ(e.without_track, 1);
  EXPECT_EQ(e.id_switches, 2);
  EXPECT_EQ(e.fragmentations, 1);
  EXPECT_EQ(e.split, 2);
  EXPECT_EQ(e.joined, 1);
  EXPECT_EQ(e.tracks, 4);
  EXPECT_DOUBLE_EQ(e.mota, 1.0 - 4.0 / 10.0);
}

TEST(TrackErrors, ATrackStaysWithItsVehicleWhileTheirBoxesOverlap) {
  MadeTracks made(2);
  for (TruthFrame& frame : made.scene.truth->frames) frame.vehicles.pop_back();
  made.find(0, 0, 5);
  made.find(1, 0, 8);  // overlaps more
  made.find(1, 0, 5);
  made.vehicles.frames[1].vehicles[1].box.x1 += 20.0;
  const TrackErrors e = track_errors(made.scene, made.vehicles);
  EXPECT_EQ(e.id_switches, 0);
  EXPECT_EQ(e.false_positives, 1);
}

TEST(TrackErrors, OneThatIsMissedIsNotTheHiddenOneBehindIt) {
  // The second is hidden by the first, so that it does not count; both are found but in frame 2,
  // where only the hidden one is.
  MadeTracks made(4);
  for (int i = 0; i < 4; ++i) {
    TruthVehicle& hidden = made.scene.truth->frames[static_cast<std::size_t>(i)].vehicles[1];
    hidden.box = MadeTracks::box(0);
    hidden.box.x1 += 20.0;
    hidden.box.x2 += 20.0;
    hidden.occlusion = 0.8;
    if (i != 2) made.find(i, 0, 5);
    made.find(i, 0, 6);
    VehicleEstimate& behind = made.vehicles.frames[static_cast<std::size_t>(i)].vehicles.back();
    behind.box = hidden.box;
  }
  const TrackErrors e = track_errors(made.scene, made.vehicles);
  EXPECT_EQ(e.id_switches, 0);
  EXPECT_EQ(e.true_vehicles, 4);
  EXPECT_EQ(e.matched, 3);
  EXPECT_EQ(e.false_positives, 0);
}

TEST(TrackErrors, VehiclesThatDoNotCountAreNeitherMissedNorFalse) {
  MadeTracks made(3);
  for (TruthFrame& frame : made.scene.truth->frames) frame.vehicles[1].occlusion = 0.9;
  for (int i = 0; i < 3; ++i) {
    made.find(i, 0, 5);
    if (i == 1) made.find(i, 1, 6);
  }
  const TrackErrors e = track_errors(made.scene, made.vehicles);
  EXPECT_EQ(e.true_vehicles, 3);
  EXPECT_EQ(e.true_tracks, 1);
  EXPECT_DOUBLE_EQ(e.mota, 1.0);
}

}  // namespace
}  // namespace camber
