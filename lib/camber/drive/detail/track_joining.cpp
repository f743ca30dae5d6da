#include "camber/drive/detail/track_joining.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <tuple>

#include "camber/drive/detail/vehicle_path.h"

namespace camber::internal {
namespace {

constexpr double kMostSquared = 16.0;    // squared Mahalanobis distance of two parts' places
constexpr double kAcceleration = 2.0;    // m^2 / s^3, as TrajectoryNoise::acceleration_density
constexpr double kLongestHidden = 3.0;   // s
constexpr double kPlainly = 9.0;         // less cost of one that moves
constexpr std::size_t kViewsAbout = 10;  // that a moving vehicle's velocity is fitted to
/// m^3 of a road with vehicles parked on both sides that have one.
constexpr double kRoadWithOne = 120.0;

using Places = std::vector<TrackPlace>;

/// Groups of detections of which no two are of one frame.
class TrackSets {
 public:
  void add(const Detection& d) {
    if (index_.emplace(d, parent_.size()).second) {
      parent_.push_back(parent_.size());
      members_.push_back({d});
    }
  }
  void join(const Detection& a, const Detection& b) {
    std::size_t x = root(index_.at(a)), y = root(index_.at(b));
    if (x == y || meet(x, y)) return;
    if (members_[x].size() < members_[y].size()) std::swap(x, y);
    parent_[y] = x;
    members_[x].insert(members_[y].begin(), members_[y].end());
    members_[y].clear();
  }
  const std::set<Detection>& with(const Detection& d) { return members_[root(index_.at(d))]; }

  std::vector<std::vector<Detection>> groups() const {
    std::vector<std::vector<Detection>> out;
    for (const std::set<Detection>& m : members_) {
      if (!m.empty()) out.emplace_back(m.begin(), m.end());
    }
    std::sort(out.begin(), out.end());
    return out;
  }

 private:
  bool meet(std::size_t x, std::size_t y) const {
    const std::set<Detection>&few = members_[members_[x].size() < members_[y].size() ? x : y],
          &many = members_[members_[x].size() < members_[y].size() ? y : x];
    return std::any_of(few.begin(), few.end(), [&](const Detection& d) {
      const auto at = many.lower_bound({d.first, std::numeric_limits<int>::min()});
      return at != many.end() && at->first == d.first;
    });
  }
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  std::map<Detection, std::size_t> index_;
  std::vector<std::size_t> parent_;
  std::vector<std::set<Detection>> members_;
};

struct Link {
  Detection from, to;
  bool neighbours = false;  // no frame between them has vehicles
  int votes = 0;            // windows that make it, less those that see both and do not
  bool unanimous = false;
};

/// Detections that windows take for one vehicle; the surest first.
std::vector<Link> links_of(const std::vector<WindowMeasurement>& windows) {
  std::map<std::pair<Detection, Detection>, Link> links;
  std::map<std::pair<int, int>, int> windows_with;  // both frames
  std::set<int> with_vehicles;
  for (const WindowMeasurement& window : windows) {
    for (const auto& t : window.tracked) with_vehicles.insert(t.frame);
  }
  for (const WindowMeasurement& window : windows) {
    if (window.tracked.empty()) continue;
    std::set<int> seen;  // frames with vehicles
    for (const auto& t : window.tracked) seen.insert(t.frame);
    std::map<int, Detection> last;  // by the window's track
    for (const auto& t : window.tracked) {
      const Detection now{t.frame, t.id};
      const auto [at, is_new] = last.emplace(t.track, now);
      if (is_new) continue;
      const Detection before = std::exchange(at->second, now);
      const bool next = *std::next(with_vehicles.find(before.first)) == now.first;
      Link& link =
          links.emplace(std::make_pair(before, now), Link{before, now, next}).first->second;
      ++link.votes;
    }
    for (auto a = seen.begin(); a != seen.end(); ++a) {
      for (auto b = std::next(a); b != seen.end(); ++b) ++windows_with[{*a, *b}];
    }
  }
  std::vector<Link> out;
  for (auto& [pair, link] : links) {
    const int both = windows_with[{pair.first.first, pair.second.first}];
    link.unanimous = link.votes == both;
    link.votes = 2 * link.votes - both;
    out.push_back(link);
  }
  const auto rank = [](const Link& l) {
    return std::make_tuple(l.neighbours && l.unanimous, l.neighbours, l.votes);
  };
  std::stable_sort(out.begin(), out.end(),
                   [&](const Link& a, const Link& b) { return rank(a) > rank(b); });
  return out;
}

/// Where a vehicle is at a time.
struct Whereabouts {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// A place, or a place and a velocity, by some views.
struct MotionFit {
  Eigen::VectorXd at;
  Eigen::MatrixXd covariance;
  double cost = 0.0;  // sum of squares for views that are not alike
};

std::optional<MotionFit> fit_motion(const Places& views, bool moves, double time) {
  const Eigen::Index size = moves ? 6 : 3;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(size);
  if (moves) normal.diagonal().tail<3>().setConstant(1.0 / (kSpeedSigma * kSpeedSigma));
  const double alike = std::min(kViewsAlike, static_cast<double>(views.size()));
  const Eigen::Vector3d origin = views.front().in_world;
  double squares = 0.0;
  for (const TrackPlace& v : views) {
    const Eigen::Matrix3d information = v.covariance.inverse() / alike;
    Eigen::MatrixXd by = Eigen::MatrixXd::Zero(3, size);
    by.leftCols<3>().setIdentity();
    if (moves) by.rightCols<3>() = (v.time_s - time) * Eigen::Matrix3d::Identity();
    const Eigen::Vector3d off = v.in_world - origin;
    normal += by.transpose() * information * by;
    right += by.transpose() * information * off;
    squares += off.dot(information * off);
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(normal);
  if (factor.info() != Eigen::Success) return std::nullopt;
  MotionFit out;
  out.at = factor.solve(right);
  out.cost = squares - right.dot(out.at);
  out.at.head<3>() += origin;
  out.covariance = factor.solve(Eigen::MatrixXd::Identity(size, size));
  return out;
}

bool may_stand(const Places& views) {
  const auto stands = fit_motion(views, false, views.front().time_s);
  const auto moves = fit_motion(views, true, views.front().time_s);
  return stands && moves && stands->cost - moves->cost < kPlainly;
}

/// Where a vehicle that some of its views show is at another time.
std::optional<Whereabouts> whereabouts(const Places& views, bool stands, double from, double to) {
  const auto fit = fit_motion(views, !stands, from);
  if (!fit) return std::nullopt;
  if (stands) return Whereabouts{fit->at, fit->covariance};
  const double wait = to - from;
  Eigen::Matrix<double, 3, 6> by;
  by << Eigen::Matrix3d::Identity(), wait * Eigen::Matrix3d::Identity();
  Whereabouts out{by * fit->at, by * fit->covariance * by.transpose()};
  out.covariance.diagonal().array() += kAcceleration * std::pow(std::abs(wait), 3) / 3.0;
  return out;
}

struct Meeting {
  double squared = 0.0;   // Mahalanobis distance of the places
  double log_odds = 0.0;  // that they are one vehicle's and not another one's
};

Meeting meeting_of(const Whereabouts& a, const Whereabouts& b) {
  const Eigen::Matrix3d covariance = a.covariance + b.covariance;
  const Eigen::Vector3d off = b.place - a.place;
  const double squared = off.dot(covariance.llt().solve(off));
  const double spread = std::pow(2.0 * M_PI, 1.5) * std::sqrt(covariance.determinant());  // m^3
  return Meeting{squared, std::log(kRoadWithOne / spread) - 0.5 * squared};
}

/// Of one that was hidden against one that is new, in a frame: it comes back after any time as
/// likely as after its double.
double log_odds_of_return(double frames) {
  constexpr double kNew = 0.2;  // vehicles a frame (docs/notes/drives.md)
  return -std::log(kNew * std::max(1.0, frames));
}

/// The views nearest to a time, the nearest first.
Places views_about(const Places& views, double time) {
  Places out = views;
  std::stable_sort(out.begin(), out.end(), [&](const TrackPlace& a, const TrackPlace& b) {
    return std::abs(a.time_s - time) < std::abs(b.time_s - time);
  });
  if (out.size() > kViewsAbout) out.resize(kViewsAbout);
  return out;
}

/// How far the way of a part, by its views about there, misses another's first view.
std::optional<Meeting> meeting_at(const Places& about, const Places& inner) {
  const double time = inner.front().time_s;
  const bool stands = may_stand(about) && may_stand(inner);
  const auto a = whereabouts(about, stands, time, time);
  const auto b = whereabouts(views_about(inner, time), stands, time, time);
  if (!a || !b) return std::nullopt;
  return meeting_of(*a, *b);
}

/// How far the way of an earlier part misses a later one.
std::optional<Meeting> meeting_of(Places before, Places after) {
  if (before.empty() || after.empty()) return std::nullopt;
  const double left = before.back().time_s, found = after.front().time_s;
  const bool stands = may_stand(before) && may_stand(after);
  if (!stands) {
    if (before.size() > kViewsAbout) before.erase(before.begin(), before.end() - kViewsAbout);
    if (after.size() > kViewsAbout) after.resize(kViewsAbout);
  }
  const auto a = whereabouts(before, stands, left, found);
  const auto b = whereabouts(after, stands, found, found);
  if (!a || !b) return std::nullopt;
  return meeting_of(*a, *b);
}

/// Joins detections by what was placed of them.
class Joiner {
 public:
  Joiner(const std::vector<WindowMeasurement>& windows,
         const std::map<Detection, PlacedDetection>& placed)
      : placed_(placed) {
    for (const WindowMeasurement& w : windows) {
      for (const VehicleFrame& frame : w.vehicles) {
        for (const VehicleEstimate& v : frame.vehicles) sets_.add({frame.id, v.id});
      }
      for (const auto& t : w.tracked) sets_.add({t.frame, t.id});
    }
    std::vector<Link> doubtful;
    for (const Link& link : links_of(windows)) {
      const bool sure = link.neighbours && link.unanimous;
      if (sure && link.votes < 2 && squared_distance(link.from, link.to) > kMostWithin) {
        doubtful.push_back(link);
      } else if (sure || goes_on(link)) {
        sets_.join(link.from, link.to);
      }
    }
    if (!placed.empty()) bridge();
    for (const Link& link : doubtful) sets_.join(link.from, link.to);
  }
  /// @param groups  as they are; only hidden vehicles are joined.
  Joiner(const std::vector<std::vector<Detection>>& groups,
         const std::map<Detection, PlacedDetection>& placed)
      : placed_(placed) {
    for (const std::vector<Detection>& group : groups) {
      for (const Detection& d : group) sets_.add(d);
      for (const Detection& d : group) sets_.join(group.front(), d);
    }
    bridge();
  }
  std::vector<std::vector<Detection>> groups() const { return sets_.groups(); }

 private:
  template <typename Iterator>
  Places places(Iterator first, Iterator last) const {
    Places out;
    for (; first != last; ++first) {
      const auto found = placed_.find(*first);
      if (found != placed_.end()) out.push_back(found->second.place);
    }
    return out;
  }

  /// Of two detections that may have moved in between; 0 where one was not placed.
  double squared_distance(const Detection& a, const Detection& b) const {
    const auto from = placed_.find(a), to = placed_.find(b);
    if (from == placed_.end() || to == placed_.end()) return 0.0;
    return internal::squared_distance(from->second.place, to->second.place);
  }

  bool goes_on(const Link& link) {
    const std::set<Detection>&a = sets_.with(link.from), &b = sets_.with(link.to);
    const auto meeting = meeting_of(places(a.begin(), a.upper_bound(link.from)),
                                    places(b.lower_bound(link.to), b.end()));
    return !meeting || meeting->squared < kMostSquared;
  }

  struct Part {
    Detection first;
    std::string vehicle_class;
    Places places;
  };

  /// s, from one frame to the next.
  double shortest_step() const {
    double out = kLongestHidden;
    const TrackPlace* before = nullptr;
    for (const auto& [detection, placed] : placed_) {
      const double step = before ? placed.place.time_s - before->time_s : 0.0;
      if (step > 0.0) out = std::min(out, step);
      before = &placed.place;
    }
    return out;
  }

  std::vector<Part> parts_by_time() const {
    std::vector<Part> parts;
    for (const std::vector<Detection>& group : sets_.groups()) {
      Part part;
      part.first = group.front();
      part.places = places(group.begin(), group.end());
      if (part.places.empty()) continue;
      const auto known = std::find_if(group.begin(), group.end(),
                                      [&](const Detection& d) { return placed_.count(d) > 0; });
      part.vehicle_class = placed_.at(*known).vehicle_class;
      parts.push_back(std::move(part));
    }
    std::stable_sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) {
      return a.places.front().time_s < b.places.front().time_s;
    });
    return parts;
  }

  /// What goes on after a gap.
  void bridge() {
    const std::vector<Part> parts = parts_by_time();
    const double step = shortest_step();
    std::vector<std::tuple<double, std::size_t, std::size_t>> bridges;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const double left = parts[i].places.back().time_s;
      for (std::size_t j = i + 1; j < parts.size(); ++j) {
        const double hidden = parts[j].places.front().time_s - left;
        if (hidden > kLongestHidden) break;
        if (!(hidden > 0.0) || parts[i].vehicle_class != parts[j].vehicle_class) continue;
        const auto meeting = meeting_of(parts[i].places, parts[j].places);
        if (!meeting) continue;
        const double log_odds = meeting->log_odds + log_odds_of_return(hidden / step);
        if (log_odds >= 0.0) bridges.emplace_back(-log_odds, i, j);
      }
    }
    std::sort(bridges.begin(), bridges.end());
    std::set<std::size_t> gone_on, gone_before;
    for (const auto& [against, i, j] : bridges) {
      if (gone_on.count(i) > 0 || gone_before.count(j) > 0) continue;
      gone_on.insert(i);
      gone_before.insert(j);
      sets_.join(parts[i].first, parts[j].first);
    }
    insert(step);
  }

  /// Views between those of a longer part, in frames that no window joins to others.
  void insert(double step) {
    const std::vector<Part> parts = parts_by_time();
    std::vector<std::tuple<double, std::size_t, std::size_t>> insertions;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      for (std::size_t j = 0; j < parts.size(); ++j) {
        const Places &longer = parts[i].places, &inner = parts[j].places;
        if (inner.size() >= longer.size() || parts[i].vehicle_class != parts[j].vehicle_class ||
            inner.front().time_s <= longer.front().time_s ||
            inner.back().time_s >= longer.back().time_s) {
          continue;
        }
        const auto about = views_about(longer, inner.front().time_s);
        const double away = std::abs(about.front().time_s - inner.front().time_s);
        const auto meeting = away > kLongestHidden ? std::nullopt : meeting_at(about, inner);
        if (!meeting) continue;
        const double log_odds = meeting->log_odds + log_odds_of_return(away / step);
        if (log_odds >= 0.0) insertions.emplace_back(-log_odds, i, j);
      }
    }
    std::sort(insertions.begin(), insertions.end());
    for (const auto& [against, i, j] : insertions) sets_.join(parts[i].first, parts[j].first);
  }

  const std::map<Detection, PlacedDetection>& placed_;
  TrackSets sets_;
};

}  // namespace

std::vector<std::vector<Detection>> join_detections(
    const std::vector<WindowMeasurement>& windows,
    const std::map<Detection, PlacedDetection>& placed) {
  return Joiner(windows, placed).groups();
}

std::vector<std::vector<Detection>> bridge_detections(
    const std::vector<std::vector<Detection>>& groups,
    const std::map<Detection, PlacedDetection>& placed) {
  return Joiner(groups, placed).groups();
}

}  // namespace camber::internal
