#pragma once

// What the window holds, shared by the files that make it.

#include <QVTKOpenGLNativeWidget.h>
#include <vtkActor.h>
#include <vtkBillboardTextActor3D.h>
#include <vtkCallbackCommand.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkInteractorStyleTrackballCamera.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindowInteractor.h>
#include <vtkRenderer.h>
#include <vtkRendererCollection.h>
#include <vtkTextProperty.h>

#include <QApplication>
#include <QBuffer>
#include <QCheckBox>
#include <QComboBox>
#include <QGridLayout>
#include <QGroupBox>
#include <QKeyEvent>
#include <QLabel>
#include <QPainter>
#include <QPlainTextEdit>
#include <QScreen>
#include <QSlider>
#include <QSplitter>
#include <QStatusBar>
#include <QTimer>
#include <QVBoxLayout>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <system_error>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/render/color_map.h"
#include "camber/render/frame_overlay.h"
#include "camber/render/picture_file.h"
#include "camber/render/scene_actors.h"
#include "camber/render/scene_camera.h"
#include "viewer_window.h"

namespace camber {

constexpr double kDegrees = 180.0 / M_PI;

/// The key of each switch.
QChar key_of(SceneElement element);
QPixmap to_pixmap(const Image& image);
QString text(const char* format, ...) __attribute__((format(printf, 1, 2)));
inline QString from(const std::string& text) { return QString::fromStdString(text); }

struct Ray {
  Eigen::Vector3d start, direction;  // direction: unit
};

struct ViewerWindow::Impl {
  ViewerWindow* window = nullptr;
  LoadedResult result;
  ViewerOptions options;
  PictureContent content;
  PictureSpace space;
  ScenePictureOptions shown;  // its switches only
  std::vector<int> frames;    // ids
  std::vector<std::string> colors;
  double point_size = 2.0;
  bool grade = false, ellipses = false;  // in the image

  QVTKOpenGLNativeWidget* view = nullptr;
  vtkNew<vtkGenericOpenGLRenderWindow> gl;
  vtkNew<vtkRenderer> renderer;
  vtkNew<vtkRenderer> labels;  // over the scene: names and the picked place
  std::vector<SceneLayer> layers;
  std::vector<vtkSmartPointer<vtkBillboardTextActor3D>> names;
  vtkSmartPointer<vtkActor> marker;
  std::map<SceneElement, QCheckBox*> boxes;
  QLabel* image = nullptr;
  QPixmap photo;
  QSlider* frame_slider = nullptr;
  QLabel* frame_label = nullptr;
  QSlider* size_slider = nullptr;
  QComboBox* color_box = nullptr;
  QPlainTextEdit* facts = nullptr;
  QLabel* bar = nullptr;
  QLabel* help = nullptr;
  std::vector<std::filesystem::path> written;
  std::optional<QPoint> pressed;
  bool untouched = true;  // the scene is fitted again when the window's size changes

  // The widgets (viewer_window.cpp).
  void make_view(QSplitter* split);
  void make_side(QSplitter* split);
  QLayout* make_frame_row(QWidget* side);
  QWidget* make_switches(QWidget* side);
  QLayout* make_point_row(QWidget* side);
  void make_overlays();  ///< in the view: colour bar and help
  void connect_controls();
  double default_point_size() const;  ///< pixels

  // The scene (viewer_scene.cpp).
  void list_frames();
  void list_colors();
  /// Vehicles and truth of another frame; points and patches stay as they are.
  void place_frame(int id);
  void build_layers(const std::function<bool(SceneElement)>& wanted);
  void build_names();
  static bool is_of_frame(SceneElement element);
  bool& switch_of(SceneElement element);
  bool has(SceneElement element) const;
  void apply_switches();
  void render();
  void toggle(SceneElement element);
  void set_point_size(double pixels);
  void set_color(const std::string& name);
  void set_frame(int index);
  int frame_index() const;

  // From where it is seen (viewer_scene.cpp).
  /// What the colour bar leaves of the view, pixels.
  Box2 free_area(int width, int height) const;
  void set_view(SceneView kind);
  void set_view_from_above();
  void aim(const SceneCamera& camera);

  // What is beside the scene (viewer_side.cpp).
  void show_message(const std::string& message);
  void show_summary();
  void load_image();
  void fit_image();
  void draw_bar();
  void place_overlays();
  static QString help_text();

  // Files (viewer_side.cpp).
  void save_next(bool whole_window);
  void save(const std::filesystem::path& path, bool whole_window);

  // Picking (viewer_picking.cpp).
  Eigen::Matrix4d projection() const;
  Ray ray_at(const QPoint& at) const;
  /// The point drawn at a place: of those within five pixels and near the front the closest.
  int point_at(const QPoint& at, const Ray& ray) const;
  QString place_text(const Eigen::Vector3d& x) const;
  QString patch_facts(int id, const Eigen::Vector3d& place) const;
  QString vehicle_facts(const PlacedVehicle& placed) const;
  QString true_place(const PlacedVehicle& placed) const;
  QString point_facts(int i) const;
  /// The side text where nothing is picked.
  QString overview() const;
  void pick(const QPoint& at);
  void mark(const Eigen::Vector3d& place);
  void clear_pick();

  // Events (viewer_window.cpp).
  bool on_key(const QKeyEvent& event);
};

}  // namespace camber
