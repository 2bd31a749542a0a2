/* A number that counts what is done with it: the same source as C++ tells the operations of a step. */

#include <cmath>
#include <type_traits>

inline unsigned long long operations;

struct counted {
    double value;
    counted() = default;
    template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
    counted(T number) : value(static_cast<double>(number)) {}
    template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
    explicit operator T() const { return static_cast<T>(value); }
};

#define OPERATOR(o)                                                                                   \
    inline counted operator o(counted a, counted b) { operations++; return a.value o b.value; }       \
    inline counted &operator o##=(counted &a, counted b) { return a = a o b; }
OPERATOR(+) OPERATOR(-) OPERATOR(*) OPERATOR(/)
inline counted operator-(counted a) { return -a.value; }

#define COMPARISON(o) inline bool operator o(counted a, counted b) { return a.value o b.value; }
COMPARISON(<) COMPARISON(>) COMPARISON(<=) COMPARISON(>=) COMPARISON(==) COMPARISON(!=)

#define OF_ONE(f) inline counted f(counted a) { operations++; return std::f(a.value); }
#define OF_TWO(f) inline counted f(counted a, counted b) { operations++; return std::f(a.value, b.value); }
{{functions}}
inline counted ldexp(counted a, int n) { operations++; return std::ldexp(a.value, n); }
inline long long llround(counted a) { return std::llround(a.value); }

#undef isfinite
#undef isnan
inline bool isfinite(counted a) { return std::isfinite(a.value); }
inline bool isnan(counted a) { return std::isnan(a.value); }
