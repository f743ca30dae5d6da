#include "viewer_window.h"

#include "detail/viewer_state.h"

namespace camber {
namespace {

/// Turns about the vertical and tilts, never rolls: a road stays level.
class LevelStyle : public vtkInteractorStyleTrackballCamera {
 public:
  static LevelStyle* New();
  vtkTypeMacro(LevelStyle, vtkInteractorStyleTrackballCamera)

      void Rotate() override {
    if (!CurrentRenderer) return;
    const int* now = Interactor->GetEventPosition();
    const int* last = Interactor->GetLastEventPosition();
    const int* size = CurrentRenderer->GetRenderWindow()->GetSize();
    vtkCamera* camera = CurrentRenderer->GetActiveCamera();
    camera->SetViewUp(0.0, 0.0, 1.0);
    camera->Azimuth(-200.0 * (now[0] - last[0]) / std::max(1, size[0]));
    double along[3];
    camera->GetDirectionOfProjection(along);
    const double tilt = std::asin(std::clamp(-along[2], -1.0, 1.0)) * kDegrees;
    const double wanted =
        std::clamp(tilt - 120.0 * (now[1] - last[1]) / std::max(1, size[1]), -5.0, 89.0);
    camera->Elevation(wanted - tilt);
    camera->OrthogonalizeViewUp();
    camera->SetViewUp(0.0, 0.0, 1.0);
    CurrentRenderer->ResetCameraClippingRange();
    Interactor->Render();
  }
};
vtkStandardNewMacro(LevelStyle)

}  // namespace

/// The key of each switch.
QChar key_of(SceneElement element) {
  switch (element) {
    case SceneElement::kGrid:
      return 'g';
    case SceneElement::kTruthCloud:
      return 'd';
    case SceneElement::kPoints:
      return 'p';
    case SceneElement::kVehicles:
      return 'v';
    case SceneElement::kBoxes:
      return 'b';
    case SceneElement::kPlanes:
      return 'e';
    case SceneElement::kTruth:
      return 't';
    case SceneElement::kCameras:
      return 'c';
    case SceneElement::kPatches:
      return 'a';
    case SceneElement::kNormals:
      return 'n';
    case SceneElement::kLinks:
      return 'l';
  }
  return {};
}

bool ViewerWindow::Impl::on_key(const QKeyEvent& event) {
  if (event.modifiers() & (Qt::ControlModifier | Qt::AltModifier | Qt::MetaModifier)) {
    return false;
  }
  switch (event.key()) {
    case Qt::Key_Left:
      set_frame(frame_index() - 1);
      return true;
    case Qt::Key_Right:
      set_frame(frame_index() + 1);
      return true;
    case Qt::Key_Plus:
    case Qt::Key_Equal:
      set_point_size(point_size + 1.0);
      return true;
    case Qt::Key_Minus:
      set_point_size(point_size - 1.0);
      return true;
    case Qt::Key_1:
    case Qt::Key_R:
      set_view(SceneView::kOblique);
      return true;
    case Qt::Key_2:
      untouched = false;
      set_view(SceneView::kSide);
      return true;
    case Qt::Key_3:
      untouched = false;
      set_view_from_above();
      return true;
    case Qt::Key_4:
      untouched = false;
      shown.show_cameras = false;  // from within they only stand in the way
      apply_switches();
      set_view(SceneView::kDriver);
      return true;
    case Qt::Key_I:
      grade = !grade;
      load_image();
      return true;
    case Qt::Key_U:
      ellipses = !ellipses;
      load_image();
      return true;
    case Qt::Key_S:
      save_next((event.modifiers() & Qt::ShiftModifier) != 0);
      return true;
    case Qt::Key_H:
    case Qt::Key_F1:
    case Qt::Key_Question:
      help->setVisible(!help->isVisible());
      place_overlays();
      return true;
    case Qt::Key_Escape:
      help->hide();
      clear_pick();
      facts->setPlainText(overview());
      render();
      return true;
    case Qt::Key_Q:
      window->close();
      return true;
    case Qt::Key_M: {
      const auto now = std::find(colors.begin(), colors.end(), options.color_name);
      const auto index = static_cast<std::size_t>(now - colors.begin());
      set_color(colors[(index + 1) % colors.size()]);
      return true;
    }
    default:
      break;
  }
  const QString letter = event.text().toLower();
  for (const SceneSwitch& entry : scene_switches()) {
    if (letter != QString(key_of(entry.element))) continue;
    if (has(entry.element)) {
      toggle(entry.element);
    } else {
      show_message(std::string("there is nothing to show: no ") + entry.text);
    }
    return true;
  }
  return false;
}

void ViewerWindow::Impl::make_view(QSplitter* split) {
  view = new QVTKOpenGLNativeWidget(split);
  view->setMinimumSize(320, 240);
  view->setFocusPolicy(Qt::StrongFocus);
  gl->SetMultiSamples(space.points.size() > 500000 ? 0 : 4);
  view->setRenderWindow(gl.Get());
  renderer->SetBackground(1, 1, 1);
  gl->SetNumberOfLayers(2);
  gl->AddRenderer(renderer);
  labels->SetLayer(1);
  labels->InteractiveOff();
  labels->SetActiveCamera(renderer->GetActiveCamera());
  gl->AddRenderer(labels);
  vtkNew<LevelStyle> style;
  view->interactor()->SetInteractorStyle(style);
}

void ViewerWindow::Impl::make_side(QSplitter* split) {
  auto* side = new QWidget(split);
  auto* column = new QVBoxLayout(side);
  image = new QLabel(side);
  image->setAlignment(Qt::AlignCenter);
  image->setMinimumSize(240, 130);
  image->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Preferred);
  image->setWordWrap(true);
  column->addWidget(image);
  column->addLayout(make_frame_row(side));
  facts = new QPlainTextEdit(side);
  facts->setReadOnly(true);
  column->addWidget(facts, 1);
  column->addWidget(make_switches(side));
  column->addLayout(make_point_row(side));
}

QLayout* ViewerWindow::Impl::make_frame_row(QWidget* side) {
  auto* row = new QHBoxLayout;
  frame_label = new QLabel(side);
  frame_slider = new QSlider(Qt::Horizontal, side);
  frame_slider->setRange(0, std::max(0, static_cast<int>(frames.size()) - 1));
  frame_slider->setValue(frame_index());
  frame_slider->setEnabled(frames.size() > 1);
  row->addWidget(frame_label);
  row->addWidget(frame_slider);
  return row;
}

QWidget* ViewerWindow::Impl::make_switches(QWidget* side) {
  auto* group = new QGroupBox("Show", side);
  auto* grid = new QGridLayout(group);
  int count = 0;
  for (const SceneSwitch& entry : scene_switches()) {
    auto* box =
        new QCheckBox(QString(entry.text) + " (" + QString(key_of(entry.element)) + ")", group);
    box->setObjectName(entry.name);
    grid->addWidget(box, count / 2, count % 2);
    ++count;
    boxes[entry.element] = box;
    const SceneElement element = entry.element;
    connect(box, &QCheckBox::toggled, window, [this, element] { toggle(element); });
  }
  return group;
}

QLayout* ViewerWindow::Impl::make_point_row(QWidget* side) {
  auto* row = new QHBoxLayout;
  row->addWidget(new QLabel("colour (m)", side));
  color_box = new QComboBox(side);
  for (const std::string& name : colors) color_box->addItem(from(name));
  color_box->setCurrentText(from(options.color_name));
  row->addWidget(color_box, 1);
  row->addWidget(new QLabel("size (+ -)", side));
  size_slider = new QSlider(Qt::Horizontal, side);
  size_slider->setRange(1, 20);
  row->addWidget(size_slider, 1);
  return row;
}

void ViewerWindow::Impl::make_overlays() {
  const char* const plate = "background: rgba(255,255,255,225); color: #26282c; padding: 8px;";
  bar = new QLabel(view);
  bar->setAttribute(Qt::WA_TransparentForMouseEvents);
  help = new QLabel(help_text(), view);
  help->setStyleSheet(QString(plate) + "border: 1px solid #6e747c;");
  help->hide();
}

double ViewerWindow::Impl::default_point_size() const {
  // Half the gap between points is a size that closes them; see render_scene_picture().
  const double area = std::max(1e-6, space.right.span() * space.ahead.span());
  const double spacing =
      std::sqrt(area / static_cast<double>(std::max<std::size_t>(1, space.points.size())));
  const double pixels = 900.0 / std::max(1e-6, std::max(space.right.span(), space.ahead.span()));
  return std::clamp(std::round(0.7 * spacing * pixels), 2.0, 5.0);
}

void ViewerWindow::Impl::connect_controls() {
  connect(frame_slider, &QSlider::valueChanged, window, [this](int index) { set_frame(index); });
  connect(size_slider, &QSlider::valueChanged, window, [this](int size) { set_point_size(size); });
  connect(color_box, QOverload<int>::of(&QComboBox::activated), window,
          [this](int index) { set_color(colors[static_cast<std::size_t>(index)]); });
}

ViewerWindow::ViewerWindow(LoadedResult result, const ViewerOptions& options)
    : impl_(std::make_unique<Impl>()) {
  Impl& d = *impl_;
  d.window = this;
  d.result = std::move(result);
  d.options = options;
  d.content = d.result.content();
  if (options.frame) d.content.frame = *options.frame;
  d.content.up = options.up;
  d.space = make_picture_space(d.content, true, options.color);
  d.list_frames();
  d.list_colors();
  setWindowTitle(from(options.title + " - Camber"));
  resize(QSize(1400, 840).boundedTo(screen()->availableSize()));

  auto* split = new QSplitter(Qt::Horizontal, this);
  setCentralWidget(split);
  d.make_view(split);
  d.make_side(split);
  split->setStretchFactor(0, 1);
  split->setStretchFactor(1, 0);
  split->setSizes({980, 420});
  d.make_overlays();

  d.point_size = d.default_point_size();
  d.size_slider->setValue(static_cast<int>(d.point_size));
  d.build_layers([](SceneElement) { return true; });
  d.draw_bar();
  d.connect_controls();
  qApp->installEventFilter(this);

  show();
  d.view->setFocus();
  d.set_view(SceneView::kOblique);
  d.load_image();
  d.show_summary();
  d.facts->setPlainText(d.overview());
}

ViewerWindow::~ViewerWindow() { qApp->removeEventFilter(this); }

bool ViewerWindow::eventFilter(QObject* object, QEvent* event) {
  Impl& d = *impl_;
  auto* widget = qobject_cast<QWidget*>(object);
  if (!widget || widget->window() != this) return QMainWindow::eventFilter(object, event);
  switch (event->type()) {
    case QEvent::KeyPress:
      if (d.on_key(*static_cast<QKeyEvent*>(event))) return true;
      // VTK has keys of its own, some of which end the program.
      return widget == d.view;
    case QEvent::KeyRelease:
      return widget == d.view;
    case QEvent::MouseButtonPress: {
      const auto* mouse = static_cast<QMouseEvent*>(event);
      // An event that a widget does not want comes again for its parent.
      if (widget != d.view) break;
      d.untouched = false;
      d.pressed.reset();
      if (mouse->button() == Qt::LeftButton) d.pressed = mouse->pos();
      break;
    }
    case QEvent::MouseButtonRelease: {
      const auto* mouse = static_cast<QMouseEvent*>(event);
      if (widget == d.view && d.pressed && (mouse->pos() - *d.pressed).manhattanLength() <= 4) {
        d.pick(mouse->pos());
      }
      if (widget == d.view) d.pressed.reset();
      break;
    }
    case QEvent::Wheel:
      if (widget == d.view) d.untouched = false;
      break;
    case QEvent::Resize:
      if (widget == d.view) d.place_overlays();
      if (widget == d.view && d.untouched)
        QTimer::singleShot(0, this, [this] {
          if (impl_->untouched) impl_->set_view(SceneView::kOblique);
        });
      if (widget == d.image) d.fit_image();
      break;
    default:
      break;
  }
  return QMainWindow::eventFilter(object, event);
}

void ViewerWindow::save(const std::filesystem::path& path) { impl_->save(path, true); }

bool ViewerWindow::draws() const { return impl_->view->isValid(); }

QWidget* ViewerWindow::scene_widget() { return impl_->view; }
bool ViewerWindow::shows(SceneElement element) const {
  return impl_->has(element) && impl_->switch_of(element);
}
int ViewerWindow::frame() const { return impl_->content.frame; }
double ViewerWindow::point_size() const { return impl_->point_size; }
std::string ViewerWindow::color() const { return impl_->options.color_name; }
std::string ViewerWindow::facts() const { return impl_->facts->toPlainText().toStdString(); }
std::string ViewerWindow::message() const { return statusBar()->currentMessage().toStdString(); }
bool ViewerWindow::help_shown() const { return impl_->help->isVisible(); }
bool ViewerWindow::has_image() const { return !impl_->photo.isNull(); }
const PictureSpace& ViewerWindow::space() const { return impl_->space; }
const std::vector<std::filesystem::path>& ViewerWindow::written() const { return impl_->written; }

bool ViewerWindow::project(const Eigen::Vector3d& place, QPoint* at) const {
  const Eigen::Vector4d c = impl_->projection() * place.homogeneous();
  if (!(c.w() > 0.0)) return false;
  *at = QPoint(
      static_cast<int>(std::lround(0.5 * impl_->view->width() * (1.0 + c.x() / c.w()) - 0.5)),
      static_cast<int>(std::lround(0.5 * impl_->view->height() * (1.0 - c.y() / c.w()) - 0.5)));
  return true;
}

}  // namespace camber
