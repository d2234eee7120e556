// Style and the little script of the report: light or dark as the reader's system, prints well.
#pragma once

namespace palpate {

inline constexpr const char* kReportStyle = R"css(
:root{color-scheme:light dark;--bg:#fcfcfa;--fg:#1d2230;--soft:#626b7c;--line:#d9dce2;--card:#f1f2ef;
--grid:#e6e8ec;--c1:#2a6ae0;--c2:#c2410c;--c3:#0f8a5f;--c4:#1d2230;--limit:#b3261e;--event:#8a93a5}
@media(prefers-color-scheme:dark){:root{--bg:#14171f;--fg:#e6e8ee;--soft:#9aa3b5;--line:#333a49;
--card:#1d222d;--grid:#262c38;--c1:#6ea2ff;--c2:#ff9a5c;--c3:#4fd3a1;--c4:#f2f3f7;--limit:#ff8078;
--event:#7b859a}}
*{box-sizing:border-box}body{margin:0;background:var(--bg);color:var(--fg);
font:15px/1.5 system-ui,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
main{max-width:1120px;margin:0 auto;padding:28px 24px 60px}
h1{font-size:26px;margin:0 0 2px;letter-spacing:-.01em}h2{font-size:18px;margin:38px 0 4px}
.sub{color:var(--soft);margin:0 0 20px}.warn{border-left:4px solid var(--limit);background:var(--card);
padding:8px 14px;margin:14px 0}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(165px,1fr));gap:12px}
.card{background:var(--card);border-radius:10px;padding:12px 14px}.card b{display:block;font-size:22px;
font-weight:650;letter-spacing:-.01em}.card span{color:var(--soft);font-size:13px}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(310px,1fr));gap:16px;margin-top:12px}
figure{margin:12px 0 0}figcaption{color:var(--soft);font-size:13px;margin-top:6px}
.picture{position:relative;background:var(--card);border-radius:10px;overflow:hidden}
.picture img,.picture svg{display:block;width:100%}.picture svg{position:absolute;inset:0;height:100%}
.picture text{font-size:19px;fill:var(--fg);paint-order:stroke;stroke:var(--card);stroke-width:4px}
.ink{stroke:var(--fg);stroke-width:3;fill:none}.ink-fill{fill:var(--fg)}
.halo-line{stroke:var(--card);stroke-width:7;fill:none}
.key{display:flex;flex-wrap:wrap;gap:6px 20px;color:var(--soft);font-size:13px;margin-top:12px}
.key i{display:inline-block;width:12px;height:12px;border-radius:50%;margin-right:6px;vertical-align:-1px}
svg.plot,figure>svg{width:100%;height:auto;display:block}
.label{font-size:12px;fill:var(--soft)}.halo{paint-order:stroke;stroke:var(--bg);stroke-width:4px;fill:var(--fg)}
.grid{stroke:var(--grid)}.axis{stroke:var(--line);fill:none}
.curve{fill:none;stroke-width:1.5;stroke-linejoin:round}
.series1{stroke:var(--c1)}.series2{stroke:var(--c2)}.series3{stroke:var(--c3)}.series4{stroke:var(--c4)}
.event{stroke:var(--event);stroke-width:1}.marked{stroke:var(--soft);stroke-dasharray:2 4}
.limit{stroke:var(--limit);stroke-dasharray:7 4}.limit-label{fill:var(--limit)}.bar{fill:var(--c1)}
.tables{display:grid;grid-template-columns:repeat(auto-fit,minmax(310px,1fr));gap:0 32px}
table{border-collapse:collapse;width:100%;font-size:14px}td{border-bottom:1px solid var(--line);
padding:4px 0;vertical-align:top}td+td{text-align:right;font-variant-numeric:tabular-nums;
overflow-wrap:anywhere;padding-left:16px}
footer{margin-top:40px;color:var(--soft);font-size:13px}
)css";

}  // namespace palpate
