#include "raylift/geometry/geodesy.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <string_view>
#include <utility>
#include <vector>

#include "base/constants.h"
#include <Eigen/SVD>
#include <dlfcn.h>
#include <fmt/format.h>
#include <proj.h>
#include <proj_experimental.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Destroy {
  void operator()(PJ* object) const { proj_destroy(object); }
  void operator()(PJ_CONTEXT* context) const { proj_context_destroy(context); }
  void operator()(PJ_OBJ_LIST* list) const { proj_list_destroy(list); }
  void operator()(PJ_OPERATION_FACTORY_CONTEXT* factory) const {
    proj_operation_factory_context_destroy(factory);
  }
};
template <typename T>
using Owned = std::unique_ptr<T, Destroy>;
using Context = Owned<PJ_CONTEXT>;
using Object = Owned<PJ>;

// Returns the folder of PROJ's database that a Python wheel carries beside the module with this
// code; empty where there is none.
std::filesystem::path CarriedDatabase() {
  Dl_info module{};
  if (dladdr(reinterpret_cast<const void*>(&CarriedDatabase), &module) == 0) return {};
  const std::filesystem::path folder = std::filesystem::path(module.dli_fname).parent_path();
  return Exists(folder / "proj" / "proj.db") ? folder / "proj" : "";
}

// Returns the folders that PROJ searches beside a carried database, which comes first: grids are
// found elsewhere, too.
std::vector<std::string> FoldersOfProj(const std::string& carried) {
  std::vector<std::string> folders = {carried};
  for (const char* name : {"PROJ_DATA", "PROJ_LIB"}) {
    const char* const value = std::getenv(name);
    if (value == nullptr) continue;
    for (const std::string_view folder : SplitBy(value, ':')) folders.emplace_back(folder);
  }
  folders.emplace_back("/usr/share/proj");
  return folders;
}

Context NewContext() {
  Context context(proj_context_create());
  if (!context) throw std::bad_alloc();
  proj_log_level(context.get(), PJ_LOG_NONE);
  proj_context_set_enable_network(context.get(), 0);
  if (const std::string carried = CarriedDatabase().string(); !carried.empty()) {
    const std::vector<std::string> folders = FoldersOfProj(carried);
    std::vector<const char*> paths;
    paths.reserve(folders.size());
    for (const std::string& folder : folders) paths.push_back(folder.c_str());
    proj_context_set_search_paths(context.get(), static_cast<int>(paths.size()), paths.data());
  }
  return context;
}

[[noreturn]] void FailCrs(const std::string& definition, std::string_view message) {
  throw InputError(fmt::format("CRS \"{}\": {}", definition, message));
}

// Returns the system behind what a system with a transformation to another one is bound to.
Object Parsed(const Context& context, const std::string& definition) {
  // These may name files of grids anywhere.
  constexpr std::array<std::string_view, 4> kNamesFiles = {"proj=", "init=", "proj4_grids",
                                                           "parameterfile"};
  std::string lower = definition;
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const bool names_files = std::any_of(kNamesFiles.begin(), kNamesFiles.end(), [&](auto word) {
    return lower.find(word) != std::string::npos;
  });
  Object crs(names_files ? nullptr : proj_create(context.get(), definition.c_str()));
  if (crs && proj_get_type(crs.get()) == PJ_TYPE_BOUND_CRS) {
    crs.reset(proj_get_source_crs(context.get(), crs.get()));
  }
  if (!crs) {
    FailCrs(definition,
            "expected one like EPSG:25832, EPSG:25832+7837 or WKT, found none that is "
            "known");
  }
  return crs;
}

// Returns the part that says where on the map a point is.
Object Horizontal(const Context& context, const Object& crs) {
  Object part(proj_get_type(crs.get()) == PJ_TYPE_COMPOUND_CRS
                  ? proj_crs_get_sub_crs(context.get(), crs.get(), 0)
                  : proj_clone(context.get(), crs.get()));
  if (part && proj_get_type(part.get()) == PJ_TYPE_BOUND_CRS) {
    part.reset(proj_get_source_crs(context.get(), part.get()));
  }
  return part;
}

std::optional<CrsKind> KindOf(PJ_TYPE type) {
  switch (type) {
    case PJ_TYPE_GEOGRAPHIC_2D_CRS:
    case PJ_TYPE_GEOGRAPHIC_3D_CRS:
      return CrsKind::kGeographic;
    case PJ_TYPE_PROJECTED_CRS:
      return CrsKind::kProjected;
    case PJ_TYPE_GEOCENTRIC_CRS:
      return CrsKind::kGeocentric;
    default:
      return std::nullopt;
  }
}

int NumAxes(const Context& context, const Object& crs) {
  const Object axes(proj_crs_get_coordinate_system(context.get(), crs.get()));
  return axes ? proj_cs_get_axis_count(context.get(), axes.get()) : 0;
}

bool HasHeights(const Context& context, const Object& crs) {
  return proj_get_type(crs.get()) == PJ_TYPE_COMPOUND_CRS || NumAxes(context, crs) == 3;
}

Object WithHeights(const Context& context, Object crs) {
  if (HasHeights(context, crs)) return crs;
  return Object(proj_crs_promote_to_3D(context.get(), nullptr, crs.get()));
}

Object WithoutHeights(const Context& context, const Object& crs) {
  return Object(proj_crs_demote_to_2D(context.get(), nullptr, crs.get()));
}

Object Operation(const Context& context, const Object& from, const Object& to) {
  if (!from || !to) return nullptr;
  const Object found(
      proj_create_crs_to_crs_from_pj(context.get(), from.get(), to.get(), nullptr, nullptr));
  return Object(found ? proj_normalize_for_visualization(context.get(), found.get()) : nullptr);
}

std::optional<Vector3d> Transformed(const Object& operation, const Vector3d& point) {
  proj_errno_reset(operation.get());
  const PJ_COORD in = proj_coord(point.x(), point.y(), point.z(), HUGE_VAL);
  const PJ_COORD out = proj_trans(operation.get(), PJ_FWD, in);
  const Vector3d result(out.xyz.x, out.xyz.y, out.xyz.z);
  if (proj_errno(operation.get()) != 0 || !result.allFinite()) return std::nullopt;
  return result;
}

// Returns whether datums or heights were taken as they are where PROJ transformed last.
bool WasRough(const Context& context, const Object& operation) {
#if PROJ_AT_LEAST_VERSION(9, 1, 0)
  const Object used(proj_trans_get_last_used_operation(operation.get()));
  return !used || proj_coordoperation_has_ballpark_transformation(context.get(), used.get()) != 0;
#else  // of Ubuntu 22.04, which tells its name alone
  static_cast<void>(context);
  const std::string_view name(proj_pj_info(operation.get()).description);
  return name.find("allpark") != name.npos || name.starts_with("unavailable");
#endif
}

// Returns the operation to degrees and height of the system's own datum, from its prime meridian.
Object ToGeographic(const Context& context, const Object& horizontal, const Object& geodetic) {
  const Object datum(proj_crs_get_datum_forced(context.get(), geodetic.get()));
  const Object degrees(proj_create_ellipsoidal_3D_cs(
      context.get(), PJ_ELLPS3D_LONGITUDE_LATITUDE_HEIGHT, nullptr, 0, nullptr, 0));
  const Object geographic(proj_create_geographic_crs_from_datum(context.get(), "geographic",
                                                                datum.get(), degrees.get()));
  const Object from = WithHeights(context, Object(proj_clone(context.get(), horizontal.get())));
  return Operation(context, from, geographic);
}

// Returns the degrees from Greenwich to the prime meridian.
double PrimeMeridianDeg(const Context& context, const Object& geodetic) {
  const Object meridian(proj_get_prime_meridian(context.get(), geodetic.get()));
  double longitude = 0, radians = 0;
  if (!meridian || proj_prime_meridian_get_parameters(context.get(), meridian.get(), &longitude,
                                                      &radians, nullptr) == 0) {
    return 0;
  }
  return longitude * radians * 180 / std::numbers::pi;
}

double MetersPerUnit(const Context& context, const Object& crs, int axis) {
  const Object axes(proj_crs_get_coordinate_system(context.get(), crs.get()));
  double meters = 1;
  if (axes) {
    proj_cs_get_axis_info(context.get(), axes.get(), axis, nullptr, nullptr, nullptr, &meters,
                          nullptr, nullptr, nullptr);
  }
  return meters;
}

// Returns the meters of a unit of height: that of the system's last axis where it has heights, else
// that of a map's eastings.
double MetersPerHeightUnit(const Context& context, const Object& crs, const Object& horizontal) {
  if (proj_get_type(crs.get()) == PJ_TYPE_COMPOUND_CRS) {
    return MetersPerUnit(context, Object(proj_crs_get_sub_crs(context.get(), crs.get(), 1)), 0);
  }
  if (HasHeights(context, crs)) return MetersPerUnit(context, crs, 2);
  const bool is_map = proj_get_type(horizontal.get()) == PJ_TYPE_PROJECTED_CRS;
  return is_map ? MetersPerUnit(context, horizontal, 0) : 1;
}

std::string PointText(const Vector3d& p) {
  return fmt::format("({:.9g}, {:.9g}, {:.9g})", p.x(), p.y(), p.z());
}

// Degrees beyond its area of use within which a system may still be used.
constexpr double kMarginDeg = 6;

}  // namespace

struct Crs::Geographic {
  Context context = NewContext();
  Object crs, horizontal, operation;
  double semi_major = 0, semi_minor = 0;
  double meridian_deg = 0;
  double meters_per_height = 1;         // as the system has heights
  double meters_per_height_on_way = 1;  // where the way itself does not know their unit

  explicit Geographic(const std::string& definition)
      : crs(Parsed(context, definition)), horizontal(Horizontal(context, crs)) {}

  void FindWay(const std::string& definition) {
    const Object geodetic(proj_crs_get_geodetic_crs(context.get(), horizontal.get()));
    if (geodetic) operation = ToGeographic(context, horizontal, geodetic);
    const Object ellipsoid(proj_get_ellipsoid(context.get(), horizontal.get()));
    if (!operation || !ellipsoid ||
        proj_ellipsoid_get_parameters(context.get(), ellipsoid.get(), &semi_major, &semi_minor,
                                      nullptr, nullptr) == 0) {
      FailCrs(definition, "it has no way to longitude and latitude");
    }
    meridian_deg = PrimeMeridianDeg(context, geodetic);
    meters_per_height = MetersPerHeightUnit(context, crs, horizontal);
    if (!HasHeights(context, horizontal)) meters_per_height_on_way = meters_per_height;
  }

  // Returns longitude from Greenwich and latitude in degrees, and height in meters.
  std::optional<Vector3d> At(Vector3d point) const {
    point.z() *= meters_per_height_on_way;
    auto there = Transformed(operation, point);
    if (there) there->x() += meridian_deg;
    return there;
  }

  // Returns the point there, infinite where there is none.
  Vector3d PointAt(const Vector3d& there) const {
    const PJ_COORD back =
        proj_trans(operation.get(), PJ_INV,
                   proj_coord(there.x() - meridian_deg, there.y(), there.z(), HUGE_VAL));
    return {back.xyz.x, back.xyz.y, back.xyz.z / meters_per_height_on_way};
  }
};

Crs::Crs(const std::string& definition) : definition_(definition) {
  const auto geographic = std::make_shared<Geographic>(definition);
  const Object& horizontal = geographic->horizontal;
  const Context& context = geographic->context;
  const auto kind = horizontal ? KindOf(proj_get_type(horizontal.get())) : std::nullopt;
  if (!kind) FailCrs(definition, "expected a geographic, projected or earth-centered one");
  kind_ = *kind;
  name_ = proj_get_name(geographic->crs.get());
  has_heights_ = HasHeights(context, geographic->crs);
  geographic->FindWay(definition);
  geographic_ = geographic;
  Area area{};
  if (proj_get_area_of_use(context.get(), horizontal.get(), &area.west, &area.south, &area.east,
                           &area.north, nullptr) != 0 &&
      area.west >= -180) {
    area_ = area;
  }
}

bool Crs::Holds(const Vector3d& point) const {
  const auto found = geographic_->At(point);
  if (!found) return false;
  const Vector3d& degrees = *found;
  if (std::abs(degrees.x()) > 360 || std::abs(degrees.y()) > 90) return false;
  if (!area_) return true;
  const double width = std::remainder(area_->east - area_->west - 180, 360) + 180;
  const double from_west = std::fmod(degrees.x() - area_->west + kMarginDeg + 720, 360);
  return (width <= 0 || from_west <= width + 2 * kMarginDeg) &&
         degrees.y() >= area_->south - kMarginDeg && degrees.y() <= area_->north + kMarginDeg;
}

void Crs::Check(const Vector3d& point) const {
  if (kind_ == CrsKind::kGeocentric) {
    constexpr double kLeast = 6.3e6, kMost = 6.5e6;
    if (point.norm() >= kLeast && point.norm() <= kMost) return;
    throw InputError(fmt::format("{} is not on the earth's surface in {} (earth-centered, meters)",
                                 PointText(point), definition_));
  }
  if (Holds(point)) return;
  const bool swapped = Holds({point.y(), point.x(), point.z()});
  throw InputError(fmt::format(
      "{} is not where {} ({}) is meant for{}", PointText(point), definition_, name_,
      swapped
          ? fmt::format("; its first two numbers seem to be swapped, expected {}",
                        kind_ == CrsKind::kGeographic ? "longitude, latitude" : "easting, northing")
          : ""));
}

bool NorthingsComeFirst(const Crs& crs) {
  const Crs::Geographic& system = crs.geographic();
  const Object axes(proj_crs_get_coordinate_system(system.context.get(), system.horizontal.get()));
  const char* direction = nullptr;
  return axes &&
         proj_cs_get_axis_info(system.context.get(), axes.get(), 0, nullptr, nullptr, &direction,
                               nullptr, nullptr, nullptr, nullptr) != 0 &&
         std::string_view(direction) == "north";
}

WorldFrame WorldFrame::Parse(const std::string& given) {
  std::string text(Trim(given));
  std::ranges::replace_if(
      text, [](char c) { return c == '\n' || c == '\r'; }, ' ');
  // Names in WKT may hold an @.
  const size_t wkt_end = text.rfind(']');
  const size_t at = text.find('@', wkt_end == std::string::npos ? 0 : wkt_end);
  WorldFrame frame{.text = text, .crs = Crs(text.substr(0, at))};
  if (frame.crs.kind() == CrsKind::kGeographic) {
    FailCrs(text,
            "degrees are no coordinates of a scene: expected a projected (EPSG:32632) or "
            "earth-centered one");
  }
  if (at == std::string::npos) return frame;
  const std::vector<std::string_view> numbers = SplitBy(std::string_view(text).substr(at + 1), ',');
  for (size_t i = 0; i < 3; ++i) {
    const auto number = numbers.size() == 3 ? ParseDouble(numbers[i]) : std::nullopt;
    if (!number || !std::isfinite(*number)) {
      FailCrs(text, "expected an origin X,Y,Z of three numbers behind @");
    }
    frame.origin[static_cast<Eigen::Index>(i)] = *number;
  }
  return frame;
}

struct CrsTransform::Operation {
  Context context = NewContext();
  Object from, to, operation;
  double into_z = 1, out_of_z = 1;  // factors of heights whose unit PROJ does not change
};

CrsTransform::CrsTransform(const Crs& from, const Crs& to)
    : from_(from.definition()), to_(to.definition()), operation_(std::make_shared<Operation>()) {
  Operation& it = *operation_;
  it.from = Parsed(it.context, from_);
  it.to = Parsed(it.context, to_);
  const bool is_centered = from.kind() == CrsKind::kGeocentric || to.kind() == CrsKind::kGeocentric;
  const bool passes = !to.has_heights() && !is_centered;
  if (passes || !from.has_heights()) it.into_z = from.geographic().meters_per_height;
  if (!to.has_heights()) it.out_of_z = 1 / to.geographic().meters_per_height;
  if (from.has_heights() && !to.has_heights() && !is_centered) {
    it.from = WithoutHeights(it.context, Horizontal(it.context, it.from));
  } else if (from.has_heights() != to.has_heights()) {
    it.from = WithHeights(it.context, std::move(it.from));
    it.to = WithHeights(it.context, std::move(it.to));
  }
  it.operation = raylift::Operation(it.context, it.from, it.to);
  if (!it.operation) {
    throw InputError(fmt::format("no transformation is known from {} to {}", from_, to_));
  }
}

Vector3d CrsTransform::operator()(const Vector3d& point) const {
  const Vector3d in(point.x(), point.y(), point.z() * operation_->into_z);
  auto result = Transformed(operation_->operation, in);
  if (!result) {
    throw InputError(fmt::format("{} of {} has no place in {}", PointText(point), from_, to_));
  }
  result->z() *= operation_->out_of_z;
  return *result;
}

std::optional<std::string> CrsTransform::Warning() const {
  PJ_CONTEXT* const context = operation_->context.get();
  if (!WasRough(operation_->context, operation_->operation)) return std::nullopt;
  std::string grids;
  const Owned<PJ_OPERATION_FACTORY_CONTEXT> factory(
      proj_create_operation_factory_context(context, nullptr));
  proj_operation_factory_context_set_grid_availability_use(context, factory.get(),
                                                           PROJ_GRID_AVAILABILITY_IGNORED);
  const Owned<PJ_OBJ_LIST> known(
      proj_create_operations(context, operation_->from.get(), operation_->to.get(), factory.get()));
  const Object best(known ? proj_list_get(context, known.get(), 0) : nullptr);
  for (int i = 0; best && i < proj_coordoperation_get_grid_used_count(context, best.get()); ++i) {
    const char* name = nullptr;
    int available = 1;
    if (proj_coordoperation_get_grid_used(context, best.get(), i, &name, nullptr, nullptr, nullptr,
                                          nullptr, nullptr, &available) != 0 &&
        available == 0) {
      grids += fmt::format("{}{}", grids.empty() ? "" : ", ", name);
    }
  }
  return fmt::format(
      "{} to {} is a rough transformation: datums or heights are taken as they are, which may be "
      "off by up to 100 m{}",
      from_, to_, grids.empty() ? "" : fmt::format(" (grid {} of PROJ is not installed)", grids));
}

Matrix3d LocalFrame::Axes() const {
  const Eigen::JacobiSVD<Matrix3d> svd(crs_from_enu, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

double LocalFrame::Scale() const { return crs_from_enu.col(1).norm(); }

LocalFrame LocalFrameAt(const Crs& crs, const Vector3d& point) {
  const Crs::Geographic& geographic = crs.geographic();
  const auto there = geographic.At(point);
  if (!there) {
    throw InputError(fmt::format("{} has no place in {}", PointText(point), crs.definition()));
  }
  LocalFrame frame{.geographic = *there, .crs_from_enu = Matrix3d::Identity()};
  // Degrees per meter along the parallel and the meridian.
  const double sin_latitude = std::sin(there->y() * kRadPerDeg);
  const double a = geographic.semi_major,
               e2 = 1 - std::pow(geographic.semi_minor / geographic.semi_major, 2);
  const double w2 = 1 - e2 * sin_latitude * sin_latitude;
  const double across = a / std::sqrt(w2) + there->z();
  const double along = a * (1 - e2) / std::pow(w2, 1.5) + there->z();
  const Vector3d degrees_per_meter(1 / (across * std::cos(there->y() * kRadPerDeg) * kRadPerDeg),
                                   1 / (along * kRadPerDeg), 1);
  constexpr double kStepMeters = 10;  // coordinates of 1e7 m then tell directions to 1e-10
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = Vector3d::Unit(axis) * degrees_per_meter[axis] * kStepMeters;
    frame.crs_from_enu.col(axis) =
        (geographic.PointAt(*there + step) - geographic.PointAt(*there - step)) / (2 * kStepMeters);
  }
  if (!frame.crs_from_enu.allFinite()) {
    throw InputError(
        fmt::format("{} of {} has no directions of its own", PointText(point), crs.definition()));
  }
  return frame;
}

}  // namespace raylift
