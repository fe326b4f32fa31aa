// The part of msgpack that docs/planner_protocol.md needs: values from bytes, and a map of texts and numbers to bytes.
#pragma once
#include <bit>
#include <cstdint>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

struct Value {
    double number = 0.0;               // of a number or a boolean
    std::string bytes;                 // of a text or of packed numbers
    std::vector<Value> list;
    std::map<std::string, Value> map;
    bool none = false;

    const Value& operator[](const char* key) const { return map.at(key); }
    const Value& operator[](size_t i) const { return list[i]; }
    bool has(const char* key) const { return map.count(key) > 0; }
    std::vector<double> numbers() const {  // little-endian float64, as this machine's are
        static_assert(std::endian::native == std::endian::little);
        std::vector<double> found(bytes.size() / 8);
        std::memcpy(found.data(), bytes.data(), found.size() * 8);
        return found;
    }
};

class Reader {
public:
    explicit Reader(const std::string& data) : data_(data) {}
    Value value() {
        const unsigned kind = take(1);
        Value v;
        if (kind < 0x80) v.number = kind;
        else if (kind >= 0xe0) v.number = static_cast<int8_t>(kind);
        else if (kind < 0x90) fill_map(v, kind & 0x0f);
        else if (kind < 0xa0) fill_list(v, kind & 0x0f);
        else if (kind < 0xc0) v.bytes = text(kind & 0x1f);
        else switch (kind) {
            case 0xc0: v.none = true; break;
            case 0xc2: case 0xc3: v.number = kind - 0xc2; break;
            case 0xc4: case 0xd9: v.bytes = text(take(1)); break;
            case 0xc5: case 0xda: v.bytes = text(take(2)); break;
            case 0xc6: case 0xdb: v.bytes = text(take(4)); break;
            case 0xcb: { const uint64_t bits = take(8); std::memcpy(&v.number, &bits, 8); break; }
            case 0xcc: v.number = take(1); break;
            case 0xcd: v.number = take(2); break;
            case 0xce: v.number = take(4); break;
            case 0xcf: v.number = static_cast<double>(take(8)); break;
            case 0xd0: v.number = static_cast<int8_t>(take(1)); break;
            case 0xd1: v.number = static_cast<int16_t>(take(2)); break;
            case 0xd2: v.number = static_cast<int32_t>(take(4)); break;
            case 0xd3: v.number = static_cast<double>(static_cast<int64_t>(take(8))); break;
            case 0xdc: fill_list(v, take(2)); break;
            case 0xdd: fill_list(v, take(4)); break;
            case 0xde: fill_map(v, take(2)); break;
            case 0xdf: fill_map(v, take(4)); break;
            default: throw std::runtime_error("msgpack of a kind that the protocol does not use");
        }
        return v;
    }

private:
    uint64_t take(int count) {  // big-endian
        uint64_t found = 0;
        for (; count > 0; --count) found = found << 8 | static_cast<unsigned char>(data_.at(at_++));
        return found;
    }
    std::string text(size_t length) { at_ += length; return data_.substr(at_ - length, length); }
    void fill_list(Value& v, size_t count) { while (count-- > 0) v.list.push_back(value()); }
    void fill_map(Value& v, size_t count) {
        while (count-- > 0) { const std::string key = value().bytes; v.map[key] = value(); }
    }
    const std::string& data_;
    size_t at_ = 0;
};

inline std::string head(unsigned char kind, uint64_t length, int count) {
    std::string found(1, static_cast<char>(kind));
    while (count-- > 0) found += static_cast<char>(length >> 8 * count & 0xff);
    return found;
}
inline std::string packed(const std::string& text) { return head(0xda, text.size(), 2) + text; }
inline std::string packed(const std::vector<double>& numbers) {
    return head(0xc6, 8 * numbers.size(), 4) + std::string(reinterpret_cast<const char*>(numbers.data()), 8 * numbers.size());
}
