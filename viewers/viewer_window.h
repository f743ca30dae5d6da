#pragma once

#include <QMainWindow>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/render/loaded_result.h"
#include "camber/render/picture_space.h"

namespace camber {

struct ViewerOptions {
  PointColor color;
  std::string color_name = "height";
  std::optional<int> frame;               ///< id; none: the result's reference
  std::optional<Eigen::Vector3d> up;      ///< frame of the input
  std::string title;                      ///< of the window
  std::string snapshots = "camber-view";  ///< the key s writes NAME-1.png, NAME-2.png, ...
};

/// A result or a cloud to look at: the 3D scene of render_scene_picture() beside the frame's image,
/// facts about what is clicked, a switch for each part of the scene, and keys for everything (h
/// shows them). Needs a QApplication.
class ViewerWindow : public QMainWindow {
 public:
  /// @throws NoAnswerError if there is nothing finite to show or the cloud lacks what its colours
  ///         should mean.
  ViewerWindow(LoadedResult result, const ViewerOptions& options);
  ~ViewerWindow() override;

  /// Whether the scene's widget has OpenGL to draw with; once it is shown.
  bool draws() const;
  /// Writes a picture of the whole window as PNG. @throws OutputError.
  void save(const std::filesystem::path& path);

  /// The widget of the 3D scene, for events.
  QWidget* scene_widget();
  /// Whether a part of the scene is drawn: it has content and its switch is on.
  bool shows(SceneElement element) const;
  int frame() const;            ///< id
  double point_size() const;    ///< pixels
  std::string color() const;    ///< of the points, as --color
  std::string facts() const;    ///< the side text
  std::string message() const;  ///< the line at the bottom
  bool help_shown() const;
  bool has_image() const;  ///< the image pane shows one
  /// Where a place of the picture frame lies on the scene's widget; false: behind the eye.
  bool project(const Eigen::Vector3d& place, QPoint* at) const;
  const PictureSpace& space() const;
  /// The pictures that save() and the key s wrote, in that order.
  const std::vector<std::filesystem::path>& written() const;

 protected:
  bool eventFilter(QObject* object, QEvent* event) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
