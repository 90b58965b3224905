// On the front page, a click on the picture of a scene, or on the link below it, shows the scene in the picture's place.
document.addEventListener("DOMContentLoaded", () => {
  for (const below of document.querySelectorAll(".scene-link.live")) {
    const link = below.querySelector("a"), picture = below.previousElementSibling;
    const show = (event) => {
      event.preventDefault();
      const frame = Object.assign(document.createElement("iframe"), { src: link.href, title: link.textContent, className: "scene" });
      picture.replaceWith(frame);
      link.textContent = "Open it alone";
      link.removeEventListener("click", show);
    };
    link.addEventListener("click", show);
    picture.addEventListener("click", show);
    picture.classList.add("opens");
  }
});
