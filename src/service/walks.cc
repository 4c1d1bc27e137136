#include "service/walks.h"

#include <array>
#include <bit>
#include <chrono>
#include <cstring>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/hash.h"
#include "base/json_text.h"
#include "geometry/pose_json.h"
#include "service/problem.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::string_view kVersion = "rl-walk2";
constexpr size_t kKeyBytes = 32;
constexpr size_t kSignatureBytes = 32;
constexpr const char* kField = "session.token";
constexpr std::chrono::hours kLifetime(1);

// Puts values behind each other as bytes, or takes them from there.
class Bytes {
 public:
  explicit Bytes(std::string* written) : written_(written) {}
  explicit Bytes(std::string_view read) : read_(read) {}

  template <typename T>
  void Block(std::span<T> values) {
    if (values.empty()) return;  // null is no memory to copy to
    if (written_ != nullptr) {
      written_->append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
      return;
    }
    RAYLIFT_CHECK(read_.size() >= values.size_bytes());
    std::memcpy(values.data(), read_.data(), values.size_bytes());
    read_.remove_prefix(values.size_bytes());
  }
  template <typename T>
  void Number(T& value) {
    Block(std::span<T>(&value, 1));
  }
  template <typename T>
  void Optional(std::optional<T>& value) {
    char has = value ? 1 : 0;
    Number(has);
    if (has != 0 && !value) value.emplace();
    if (has != 0) Value(*value);
  }
  template <typename T>
  void List(std::vector<T>& values) {
    auto size = static_cast<uint32_t>(values.size());
    Number(size);
    values.resize(size);
    for (T& value : values) Value(value);
  }

  void Value(double& value) { Number(value); }
  void Value(Rigid3& pose) {
    Block(std::span<double>(pose.rotation.coeffs().data(), 4));
    Block(std::span<double>(pose.translation.data(), 3));
  }
  void Value(SinglePose& single) {
    Value(single.cam_from_world);
    Block(std::span<double>(single.covariance.data(), 36));
    Value(single.confidence);
  }
  void Value(WalkEvidence& frame) {
    Value(frame.cam_from_odometry);
    List(frame.singles);
    Value(frame.since_before.way);
    Value(frame.since_before.turn_deg);
  }
  void Value(ServedWalk& walk) {
    Number(walk.scale);
    Optional(walk.state.last_time_s);
    List(walk.state.frames);
  }

 private:
  std::string* written_ = nullptr;
  std::string_view read_;
};

// The header before the walk.
struct Header {
  char version[kVersion.size()];
  uint64_t scene;
  int64_t sealed_s;
};

int64_t SecondsOf(WalkTokens::Time time) {
  return std::chrono::duration_cast<std::chrono::seconds>(time.time_since_epoch()).count();
}

// Returns a hash of the scene's name, and of its references' names and poses.
uint64_t WorldOf(const ServedScene& scene) {
  uint64_t hash = HashBytes64(scene.name);
  for (const PosedImage& image : scene.localizer->scene().references.images) {
    const auto [q, t] = std::pair(image.cam_from_world.rotation, image.cam_from_world.translation);
    const std::array pose = {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
    hash = HashBytes64(image.name, hash);
    hash = HashBytes64(AsBytes(std::span<const double>(pose)), hash);
  }
  return hash;
}

Problem IsForged() { return {400, kField, "session: token: expected one of this service"}; }

}  // namespace

WalkTokens::WalkTokens(const std::filesystem::path& key_file) {
  if (!key_file.empty()) {
    key_ = ReadFile(key_file);
    if (key_.size() >= kKeyBytes) return;
    throw InputError(key_file, fmt::format("expected a key of {} bytes at least, found {}",
                                           kKeyBytes, key_.size()));
  }
  key_.resize(kKeyBytes);
  if (RAND_bytes(reinterpret_cast<unsigned char*>(key_.data()), kKeyBytes) == 1) return;
  throw ResourceError("the system gives no random numbers");
}

std::string WalkTokens::Signature(std::string_view bytes) const {
  std::string signature(kSignatureBytes, '\0');
  unsigned int size = 0;
  const auto* const made = HMAC(EVP_sha256(), key_.data(), static_cast<int>(key_.size()),
                                reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(),
                                reinterpret_cast<unsigned char*>(signature.data()), &size);
  if (made == nullptr || size != kSignatureBytes) throw std::bad_alloc();
  return signature;
}

std::string WalkTokens::Seal(ServedWalk walk, uint64_t scene, Time now) const {
  Header header{.version = {}, .scene = scene, .sealed_s = SecondsOf(now)};
  kVersion.copy(header.version, kVersion.size());
  std::string bytes;
  Bytes writer(&bytes);
  writer.Number(header);
  writer.Value(walk);
  return EncodeBase64(bytes + Signature(bytes));
}

ServedWalk WalkTokens::Open(std::string_view token, uint64_t scene, Time now) const {
  std::string bytes;
  try {
    bytes = DecodeBase64(token);
  } catch (const InputError&) {
    throw IsForged();
  }
  if (bytes.size() < sizeof(Header) + kSignatureBytes) throw IsForged();
  const std::string given = bytes.substr(bytes.size() - kSignatureBytes);
  bytes.resize(bytes.size() - kSignatureBytes);
  if (CRYPTO_memcmp(given.data(), Signature(bytes).data(), kSignatureBytes) != 0) throw IsForged();
  Bytes reader{std::string_view(bytes)};
  Header header;
  reader.Number(header);
  if (std::string_view(header.version, kVersion.size()) != kVersion) {
    throw Problem(410, kField, "session: token: is of another version");
  }
  if (SecondsOf(now) - header.sealed_s > std::chrono::seconds(kLifetime).count()) {
    throw Problem(410, kField, "session: token: is more than an hour old");
  }
  if (header.scene != scene) {
    throw Problem(409, kField, "session: token: is of another scene, or the scene has changed");
  }
  ServedWalk walk;
  reader.Value(walk);
  return walk;
}

SceneWalks::SceneWalks(const WalkTokens& tokens, const ServedScene& scene, int threads)
    : tokens_(tokens), world_(WorldOf(scene)), distances_(scene.localizer->scene(), threads) {}

ServedWalk SceneWalks::Before(const WalkStep& step) const {
  if (step.token.empty()) return {.scale = step.scale.value_or(OdometryScale::kKnown)};
  ServedWalk walk = tokens_.Open(step.token, world_, std::chrono::system_clock::now());
  if (step.scale && *step.scale != walk.scale) {
    throw Problem(400, "session.scale", "session: scale: is another than before");
  }
  if (!(step.time_s > walk.state.last_time_s)) {
    throw Problem(400, "session.time_s",
                  fmt::format("session: time_s: expected more than {}, that of the one before",
                              FormatDouble(*walk.state.last_time_s)));
  }
  return walk;
}

SceneWalks::Walked SceneWalks::GoOn(ServedWalk walk, const WalkedPhotograph& photograph) const {
  TrackedPose tracked = Track(photograph, distances_, {.scale = walk.scale}, walk.state);
  nlohmann::ordered_json session;
  SetMember(session, "token",
            tokens_.Seal(std::move(walk), world_, std::chrono::system_clock::now()));
  SetMember(session, "world_from_odometry", nullptr);
  SetMember(session, "scale", tracked.scale);
  if (tracked.world_from_odometry) {
    SetMember(session, "world_from_odometry", ToJson(*tracked.world_from_odometry));
  }
  return {std::move(tracked.query), JsonText(std::move(session))};
}

}  // namespace raylift
